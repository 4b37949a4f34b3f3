import dataclasses
import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from basetree.errors import InputError
from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec, TreeRCNN, load_checkpoint, make_spec, save_checkpoint
from perceptree.models.presets import NINE_ANCHORS_PX
from perceptree.models.spec import SpecError


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(1)
    path = tmp_path_factory.mktemp("checkpoint") / "deep" / "model.safetensors"
    spec = dataclasses.replace(make_spec("edge-n", "rgb", 64, 96), fpn_width=16)
    save_checkpoint(path, TreeRCNN(spec), {"data": "a stand", "steps": 3})
    return path


@pytest.mark.parametrize("modality", ["rgb", "depth"])
@pytest.mark.parametrize("preset", ["edge-n", "edge-s", "edge-l", "r50", "x101-32x4d"])
def test_a_spec_survives_json(preset: str, modality: str) -> None:
    spec = make_spec(preset, modality, anchor_ratios=(1.0, 3.0))  # type: ignore[arg-type]
    again = ModelSpec.from_dict(json.loads(json.dumps(spec.to_dict())))
    assert again == spec
    assert hash(again.anchor_sizes_px) == hash(spec.anchor_sizes_px)


def test_nine_anchors_survive_json() -> None:
    spec = make_spec("r50", anchor_sizes_px=NINE_ANCHORS_PX)
    again = ModelSpec.from_dict(json.loads(json.dumps(spec.to_dict())))
    assert again.anchor_sizes_px == NINE_ANCHORS_PX
    assert again.anchor_sizes_px[0] == (32.0, 64.0, 128.0)
    assert again.anchors_per_cell == 9


@pytest.mark.parametrize(("side", "rows"), [(32, 4), (33, 8), (90, 12), (96, 12), (720, 92)])
def test_maps_cover_the_input_padded_to_whole_cells(side: int, rows: int) -> None:
    spec = make_spec("edge-n", height=side, width=64, levels=(3, 4, 5))
    assert spec.map_size(3) == (rows, 8)
    assert spec.map_size(5) == (rows // 4, 2)
    paper = make_spec("r50", height=side, width=64)
    assert paper.map_size(6) == (-(-rows // 8), 1)


def test_presets_take_changes_and_refuse_what_is_none() -> None:
    assert make_spec("r101", detections=100, masks=False).detections == 100
    with pytest.raises(InputError, match=r"roi_levels are \(5, 6\), .* at most 5"):
        make_spec("r50", roi_levels=(5, 6))
    with pytest.raises(InputError, match="model is 'r51', expected one of: edge-n, edge-s"):
        make_spec("r51")
    with pytest.raises(InputError, match=r"unknown model setting: .*'colour'"):
        make_spec("r50", colour="red")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"height": 31}, "the input is 31x640, expected 32 to 8192 px each way"),
        ({"width": 8193}, "the input is 384x8193, expected 32 to 8192 px"),
        ({"modality": "radar"}, "modality is 'radar', expected 'rgb', 'depth' or 'both'"),
        ({"mean": (1.0,)}, "mean and std have 1 and 3 values, expected 3 for rgb"),
        ({"std": (1.0, 0.0, 1.0)}, "expected values of 1e-06 to 1e"),
        (
            {"roi_levels": (2,)},
            r"roi_levels are \(2,\), expected consecutive levels of \(3, 4, 5\)",
        ),
        ({"roi_levels": (3, 5)}, r"roi_levels are \(3, 5\), expected consecutive levels"),
        ({"roi_levels": ()}, r"roi_levels are \(\), expected consecutive levels"),
        ({"levels": (3, 5)}, "expected consecutive levels"),
        ({"levels": ()}, r"levels are \(\), expected consecutive levels, at least 2"),
        ({"levels": (1, 2, 3, 4, 5)}, "expected consecutive levels, at least 2"),
        ({"levels": (2, 3, 4)}, "expected level 5 or 6 as the last"),
        ({"levels": (5, 6, 7)}, "expected level 5 or 6 as the last"),
        (
            {"anchor_sizes_px": ((40.0,),)},
            r"expected 3 groups \(one per level\) with the same number",
        ),
        ({"anchor_sizes_px": ((40.0,), (80.0,), (90.0, 99.0))}, "with the same number of sizes"),
        ({"anchor_sizes_px": ((), (), ())}, "expected 3 groups"),
        ({"anchor_sizes_px": ((0.0,), (80.0,), (90.0,))}, "expected 0.01 to 65536 px"),
        ({"anchor_ratios": ()}, "expected at least one, 0.001 to 1000"),
        ({"anchor_offset": 1.5}, "anchor_offset is 1.5, expected 0 to 1"),
        ({"roi_samples": -1}, "roi_samples is -1, expected 0 to 64"),
        ({"keypoint_grid": "cells"}, "keypoint_grid is 'cells', expected 'subcell' or 'pixels'"),
        ({"mask_head_widths": ()}, r"mask_head_widths are \(\), expected 1 to 64 of"),
        ({"keypoint_head_widths": (8, 0)}, r"keypoint_head_widths are \(8, 0\), expected"),
        ({"fpn_width": 0}, "fpn_width is 0, expected 1 to 4096"),
        ({"box_head_width": 0}, "box_head_width is 0, expected 1 to 16384"),
        ({"depth_encoding": {}}, r"depth_encoding is \{\} for rgb, expected one for depth"),
        ({"keypoint_box_scale": 0.5}, "keypoint_box_scale is 0.5"),
        ({"nms_iou": 0.0}, "nms_iou is 0.0"),
        ({"detections": 0}, "detections is 0"),
        ({"detections": 101}, "detections is 101 with 100 proposals, expected at most 100"),
        ({"proposals": 19}, "detections is 20 with 19 proposals, expected at most 19"),
        ({"proposals_per_level": 6}, "detections is 20 with 18 proposals, expected at most 18"),
        ({"score_threshold": 1.0}, "score_threshold is 1.0"),
        ({"pad_value": 256}, "pad_value is 256"),
        ({"mask_score_weight": -0.1}, "mask_score_weight is -0.1"),
        ({"mask_score_weight": 0.3, "masks": False}, "0.3 without masks, expected 0, or masks"),
    ],
)
def test_a_spec_that_makes_no_sense_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        dataclasses.replace(make_spec("edge-n", "rgb"), **changes)  # type: ignore[arg-type]


def test_unknown_fields_and_backbones_are_refused() -> None:
    values = make_spec("edge-n", "rgb").to_dict()
    with pytest.raises(InputError, match="unknown model spec fields: colour"):
        ModelSpec.from_dict({**values, "colour": "red"})
    del values["height"]
    with pytest.raises(InputError, match="'height'"):
        ModelSpec.from_dict(values)
    with pytest.raises(InputError, match="backbone is 'vgg', expected one of"):
        TreeRCNN(dataclasses.replace(make_spec("edge-n", "rgb"), backbone="vgg"))


def test_the_detector_and_its_record_come_back(checkpoint: Path) -> None:
    model, record = load_checkpoint(checkpoint)
    assert not model.training
    assert record["training"] == {"data": "a stand", "steps": 3}
    torch.manual_seed(1)
    expected = TreeRCNN(model.spec).state_dict()
    for name, value in model.state_dict().items():
        assert torch.equal(value, expected[name]), name
    assert [path.name for path in checkpoint.parent.iterdir()] == [checkpoint.name]


def test_others_may_read_a_checkpoint_as_any_file_of_its_writer(checkpoint: Path) -> None:
    plain = checkpoint.with_name("plain")
    plain.touch()
    assert checkpoint.stat().st_mode == plain.stat().st_mode


def test_files_that_are_no_checkpoint_are_refused_in_one_line(
    checkpoint: Path, tmp_path: Path
) -> None:
    tensors = load_file(checkpoint)
    broken = tmp_path / "broken.safetensors"

    def refused(message: str) -> None:
        with pytest.raises(CheckpointError, match=message) as caught:
            load_checkpoint(broken)
        assert str(broken) in str(caught.value)
        assert "\n" not in str(caught.value)

    refused("no such file")
    broken.write_text("not a checkpoint")
    refused("not a readable safetensors file")
    broken.write_bytes(checkpoint.read_bytes()[:5000])
    refused("not a readable safetensors file")
    save_file(tensors, broken)
    refused("expected schema perceptree.checkpoint/1")
    save_file(tensors, broken, metadata={"perceptree": "{"})
    refused("not a readable safetensors file")


def test_tensors_that_do_not_fit_are_named(checkpoint: Path, tmp_path: Path) -> None:
    model, record = load_checkpoint(checkpoint)
    tensors = load_file(checkpoint)
    tensors["stranger"] = torch.zeros(1)
    del tensors["box_head.score.bias"]
    tensors["box_head.shift.bias"] = torch.zeros(9)
    path = tmp_path / "other.safetensors"
    save_file(tensors, path, metadata={"perceptree": json.dumps(record)})
    with pytest.raises(CheckpointError) as caught:
        load_checkpoint(path)
    text = str(caught.value)
    assert "box_head.score.bias is missing" in text
    assert "stranger is unexpected" in text
    assert "box_head.shift.bias has shape (9,), expected (4,)" in text
    assert model.spec.name == "edge-n-rgb"


def test_a_folder_that_cannot_be_written_is_named(checkpoint: Path, tmp_path: Path) -> None:
    model, _ = load_checkpoint(checkpoint)
    (tmp_path / "file").write_text("")
    with pytest.raises(CheckpointError, match="cannot be written"):
        save_checkpoint(tmp_path / "file" / "model.safetensors", model, {})


@pytest.mark.parametrize("preset", ["edge-n", "r50"])
def test_a_size_of_nothing_is_not_the_presets(preset: str) -> None:
    with pytest.raises(SpecError, match="the input is 0x640"):
        make_spec(preset, "rgb", 0, 640)
