import dataclasses
import json
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file

from perceptree.errors import CheckpointError, PerceptreeError
from perceptree.models import ModelSpec, TreeRCNN, light_spec, load_checkpoint, save_checkpoint


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    torch.manual_seed(1)
    path = tmp_path_factory.mktemp("checkpoint") / "deep" / "model.safetensors"
    spec = dataclasses.replace(light_spec("rgb", 64, 96), fpn_width=16)
    save_checkpoint(path, TreeRCNN(spec), {"data": "a stand", "steps": 3})
    return path


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_a_spec_survives_json(modality: str) -> None:
    spec = light_spec(modality)  # type: ignore[arg-type]
    assert ModelSpec.from_dict(json.loads(json.dumps(spec.to_dict()))) == spec


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"height": 100}, "the input is 100x640, expected multiples of 32"),
        ({"modality": "radar"}, "modality is 'radar', expected 'rgb' or 'depth'"),
        ({"mean": (1.0,)}, "mean and std have 1 and 3 values, expected 3 for rgb"),
        ({"std": (1.0, 0.0, 1.0)}, "expected positive values"),
        ({"roi_levels": (2,)}, r"roi_levels are \(2,\), expected some of \(3, 4, 5\)"),
        ({"levels": (3, 5)}, "expected consecutive ones"),
        ({"anchor_sizes_px": (40.0,)}, "1 anchor sizes and 3 ratios, expected 3 sizes"),
        ({"depth_encoding": {}}, "depth_encoding is for the depth modality"),
        ({"keypoint_box_scale": 0.5}, "keypoint_box_scale is 0.5"),
        ({"nms_iou": 0.0}, "nms_iou is 0.0"),
        ({"detections": 0}, "detections is 0"),
        ({"score_threshold": 1.0}, "score_threshold is 1.0"),
        ({"pad_value": 256}, "pad_value is 256"),
    ],
)
def test_a_spec_that_makes_no_sense_is_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(PerceptreeError, match=message):
        dataclasses.replace(light_spec("rgb"), **changes)  # type: ignore[arg-type]


def test_unknown_fields_and_backbones_are_refused() -> None:
    values = light_spec("rgb").to_dict()
    with pytest.raises(PerceptreeError, match="unknown model spec fields: colour"):
        ModelSpec.from_dict({**values, "colour": "red"})
    del values["height"]
    with pytest.raises(PerceptreeError, match="'height'"):
        ModelSpec.from_dict(values)
    with pytest.raises(PerceptreeError, match="unknown backbone 'vgg', expected one of"):
        TreeRCNN(dataclasses.replace(light_spec("rgb"), backbone="vgg"))


def test_the_detector_and_its_record_come_back(checkpoint: Path) -> None:
    model, record = load_checkpoint(checkpoint)
    assert not model.training
    assert record["training"] == {"data": "a stand", "steps": 3}
    torch.manual_seed(1)
    expected = TreeRCNN(model.spec).state_dict()
    for name, value in model.state_dict().items():
        assert torch.equal(value, expected[name]), name
    assert [path.name for path in checkpoint.parent.iterdir()] == [checkpoint.name]


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
    assert "stranger is surplus" in text
    assert "box_head.shift.bias has shape (9,), expected (4,)" in text
    assert model.spec.name == "light-rgb"


def test_a_folder_that_cannot_be_written_is_named(checkpoint: Path, tmp_path: Path) -> None:
    model, _ = load_checkpoint(checkpoint)
    (tmp_path / "file").write_text("")
    with pytest.raises(CheckpointError, match="cannot be written"):
        save_checkpoint(tmp_path / "file" / "model.safetensors", model, {})
