"""Small checkpoints that would take much memory, and broken ones, are refused."""

import json
import pickle
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from json_faults import faults
from safetensors.torch import save

from basetree.errors import InputError
from perceptree.errors import CheckpointError
from perceptree.models import TreeRCNN, load_checkpoint, make_spec, save_checkpoint
from perceptree.models.anchors import level_anchors
from perceptree.models.checkpoint import tensors_of
from perceptree.models.spec import ModelSpec, SpecError
from perceptree.models.weights.reading import read_weights

SPEC = make_spec("edge-n", "depth", 64, 128, fpn_width=16, box_head_width=16)


def write(path: Path, tensors: dict[str, torch.Tensor], **changes: Any) -> Path:
    spec = SPEC.to_dict() | changes
    record = {"schema": "perceptree.checkpoint/1", "spec": spec, "training": {}}
    path.write_bytes(save(tensors, metadata={"perceptree": json.dumps(record)}))
    return path


def test_an_exported_model_is_told(tmp_path: Path) -> None:
    (tmp_path / "model.onnx").write_bytes(b"\x08\x08")
    with pytest.raises(CheckpointError, match=r"is an exported model, .*; `edgetree eval` and"):
        load_checkpoint(tmp_path / "model.onnx")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fpn_width": 16_000}, "fpn_width is 16000, expected 1 to 4096"),
        ({"detections": 10**9}, "detections is 1000000000, expected 1 to 10000"),
        ({"detections": 1e9}, "detections is 1000000000.0, expected int"),
        ({"proposals": int("9" * 400)}, "expected 1 to 100000"),
        ({"mask_head_widths": [64] * 1000}, "expected 1 to 64 of 1 to 4096"),
        ({"roi_levels": [3, 10**18]}, "expected consecutive levels"),
        ({"anchor_ratios": [1.0] * 1000}, "expected at most 16 each"),
        ({"std": [float("nan")]}, "std is (nan,), expected tuples of float, finite"),
        ({"mean": [10**400]}, "expected tuples of float, finite"),
        ({"anchor_sizes_px": [[2**63], [64], [128]]}, "expected 0.01 to 65536 px"),
        ({"anchor_sizes_px": [[1e-30], [64], [128]]}, "expected 0.01 to 65536 px"),
        ({"anchor_ratios": [1e-300]}, "expected at least one, 0.001 to 1000"),
        ({"std": [1e-300]}, "expected values of 1e-06 to 1e+06"),
        ({"mean": [2**63]}, "expected values of at most 1e+06"),
        ({"keypoint_box_scale": 1e300}, "expected 1 to 100"),
        ({"depth_encoding": {"near_m": []}}, "depth_encoding: "),
        ({"depth_encoding": 3}, "depth_encoding: "),
        ({"height": 8192, "width": 8192, "anchor_ratios": [1.0] * 16}, "expected at most 20000000"),
        ({"nms_iou": "0.5"}, "nms_iou is 0.5, expected float, finite"),
        ({"masks": 1}, "masks is 1, expected bool"),
        ({"levels": [[[3]]]}, "expected tuples of int"),
    ],
)
def test_a_spec_out_of_range_is_named_before_a_network_is_built(
    change: dict[str, Any], message: str, tmp_path: Path
) -> None:
    path = write(tmp_path / "small.safetensors", {"a": torch.zeros(1)}, **change)
    with pytest.raises(CheckpointError) as caught:
        load_checkpoint(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    with pytest.raises(SpecError):
        ModelSpec.from_dict(SPEC.to_dict() | change)


def test_any_value_of_a_spec_is_taken_or_named() -> None:
    taken = 0
    for what, values in faults(json.loads(json.dumps(SPEC.to_dict()))):
        try:
            spec = ModelSpec.from_dict(values)
            tensors_of(spec)
        except InputError:
            continue
        except Exception as error:  # noqa: BLE001 - what was changed is told
            pytest.fail(f"{what}: {error!r}")
        taken += 1
        for level, sizes_px in zip(spec.levels, spec.anchor_sizes_px, strict=True):
            anchors = level_anchors(2, 2, 2**level, sizes_px, spec.anchor_ratios)
            assert anchors.isfinite().all(), what
    assert taken > 20


def test_whole_numbers_of_a_file_become_floats() -> None:
    spec = ModelSpec.from_dict(SPEC.to_dict() | {"mean": [3], "anchor_ratios": [1, 2]})
    assert [type(value) for value in (*spec.mean, *spec.anchor_ratios)] == [float] * 3


def test_memory_for_weights_is_taken_after_the_check_of_the_tensors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "wide.safetensors", {"a": torch.zeros(1)}, fpn_width=4096)
    made = []
    build = TreeRCNN.__init__

    def watched(self: TreeRCNN, spec: ModelSpec) -> None:
        build(self, spec)
        made.append(next(self.parameters()).device.type)

    monkeypatch.setattr(TreeRCNN, "__init__", watched)
    with pytest.raises(CheckpointError, match="is missing"):
        load_checkpoint(path)
    assert made == ["meta"]


def test_weights_that_are_no_numbers_are_refused(tmp_path: Path) -> None:
    model = TreeRCNN(SPEC)
    for value, message in (
        (float("nan"), r"box_head\.score\.weight holds NaN or infinity"),
        (-2e30, r"box_head\.score\.weight holds -2e\+30, expected -1e\+06 to 1e\+06"),
    ):
        with torch.no_grad():
            model.box_head.score.weight[0, 0] = value
        save_checkpoint(tmp_path / "wrong.safetensors", model, {})
        with pytest.raises(CheckpointError, match=message):
            load_checkpoint(tmp_path / "wrong.safetensors")


@pytest.mark.parametrize("record", ["[" * 100_000, '{"schema": "perceptree.checkpoint/1"}', "1"])
def test_records_that_are_none_are_refused(record: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.safetensors"
    path.write_bytes(save({"a": torch.zeros(1)}, metadata={"perceptree": record}))
    with pytest.raises(CheckpointError, match=r"odd\.safetensors: "):
        load_checkpoint(path)


def test_many_names_of_one_tensor_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "shared.pth"
    one = torch.zeros(20_000, dtype=torch.float16)
    torch.save({"model": {f"layer{number}": one for number in range(800)}}, path)
    assert path.stat().st_size < 200_000
    with pytest.raises(CheckpointError, match="800 tensors of 32000000 bytes in a file of"):
        read_weights(path)
    path = tmp_path / "shared.pkl"
    array = np.zeros(20_000, np.float16)
    path.write_bytes(pickle.dumps({"model": {f"layer{number}": array for number in range(800)}}))
    with pytest.raises(CheckpointError, match="800 tensors of 32000000 bytes in a file of"):
        read_weights(path)


class _Encoded:
    """Pickles as the encoding of one long text."""

    text = "a" * 100_000

    def __reduce__(self) -> Any:
        import _codecs

        return _codecs.encode, (self.text, "latin1")


def test_many_encodings_of_one_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "codecs.pkl"
    path.write_bytes(pickle.dumps({"model": [_Encoded() for _ in range(1000)]}))
    assert path.stat().st_size < 200_000
    with pytest.raises(CheckpointError, match="more encoded text than the file holds"):
        read_weights(path)


def test_a_compressed_file_that_unpacks_to_more_is_refused(tmp_path: Path) -> None:
    plain, path = tmp_path / "plain.pth", tmp_path / "bomb.pth"
    torch.save({"model": {"layer": torch.zeros(2_000_000)}}, plain)
    with zipfile.ZipFile(plain) as source, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as out:
        for entry in source.infolist():
            out.writestr(entry.filename, source.read(entry))
    with pytest.raises(CheckpointError, match="bytes unpacked, and only"):
        read_weights(path)
