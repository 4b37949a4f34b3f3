"""``perceptree import``: convert a published checkpoint."""

import dataclasses
import hashlib
import importlib.util
import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from perceptree.models import TreeRCNN, load_checkpoint, make_spec
from perceptree.models.weights.detectron2 import our_name, their_name

Result = tuple[int, str, str]
Call = Callable[..., Result]


@pytest.fixture(scope="module")
def weights() -> dict[str, Tensor]:
    """A ResNet-50 with narrow heads and no masks, with Detectron2's names."""
    spec = dataclasses.replace(
        make_spec("r50", masks=False), fpn_width=8, box_head_width=8, keypoint_head_widths=(8,) * 8
    )
    return {
        their_name(name): value
        for name, value in TreeRCNN(spec).state_dict().items()
        if not name.endswith("num_batches_tracked")
    }


@pytest.fixture
def checkpoint(weights: dict[str, Tensor], tmp_path: Path) -> Path:
    path = tmp_path / "model_final.pth"
    torch.save({"model": weights, "iteration": 3}, path)
    return path


def sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_the_recognised_model_and_next_steps_are_printed(
    call: Call, checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    code, printed, told = call("import", checkpoint)
    assert code == 0
    assert printed.splitlines()[0] == "r50: resnet50, stride in the 1x1"
    assert "input: rgb, 1280x720, pixel std 1, 1, 1" in printed
    assert "predicts: boxes, keypoints; 3 anchors per cell, " in printed
    assert "anchors: 32, 64, 128, 256, 512 px at the levels 2 to 6, ratios 0.5, 1, 2\n" in printed
    assert f"sha256 of the imported file: {sha256(checkpoint)}\n" in printed
    assert "next: perceptree eval model_final.safetensors DATA\n" in printed
    assert "edgetree export model_final.safetensors --data DATA --out model.onnx\n" in printed
    assert told.count("\n") == 1
    assert "anchor sizes 32,64,128,256,512 px (Detectron2's for 3 per cell)" in told
    assert (
        f"{checkpoint} does not contain these settings, assumed: pixel mean of ImageNet, stride"
        in told
    )
    assert [path.name for path in folder.iterdir()] == ["model_final.safetensors"]


def test_json_is_one_object_that_agrees_with_the_file(
    call: Call, checkpoint: Path, tmp_path: Path
) -> None:
    out = tmp_path / "new" / "ours.safetensors"
    options = ("--modality", "depth", "--height", 90, "--width", 160, "--stride-in", "3x3")
    options += ("--anchor-sizes", "16,32,64,128,256", "--anchor-ratios", "1,2,4")
    code, printed, told = call("import", checkpoint, "--out", out, *options, "--json")
    assert code == 0
    assert "depth from 0 to 20 m as 0 to 255" in told
    report = json.loads(printed)
    model, record = load_checkpoint(out)
    assert (model.spec.height, model.spec.width, model.spec.modality) == (90, 160, "depth")
    assert not model.spec.stride_in_1x1
    assert not model.spec.masks
    assert report["checkpoint"] == str(out)
    assert report["stride_in"] == "3x3"
    assert report["pixel_std"] == list(model.spec.std)
    assert report["parameters"] == sum(value.numel() for value in model.parameters())
    assert report["anchor_sizes_px"] == [[16.0], [32.0], [64.0], [128.0], [256.0]]
    assert report["anchor_ratios"] == list(model.spec.anchor_ratios) == [1.0, 2.0, 4.0]
    assert model.spec.anchor_sizes_px == ((16.0,), (32.0,), (64.0,), (128.0,), (256.0,))
    assert report["sha256"] == record["training"]["sha256"] == sha256(checkpoint)
    assert record["training"]["data"] == "imported from model_final.pth"


def test_imported_starting_weights_can_be_trained(
    call: Call, checkpoint: Path, tmp_path: Path
) -> None:
    out = tmp_path / "init.safetensors"
    code, printed, _ = call("import", checkpoint, "--out", out, "--as-init")
    assert code == 0
    assert f"next: perceptree train DATA --init {out} --out RUN\n" in printed
    model, record = load_checkpoint(out)
    assert model.spec.masks
    fresh = record["training"]["fresh"]
    assert "box_head.score.weight" in fresh
    assert "mask_head.score.weight" in fresh
    assert "backbone.trunk.conv1.weight" not in fresh
    assert f"fresh: {len(fresh)} tensors" in printed


def test_a_complete_file_gives_no_warning(
    call: Call, weights: dict[str, Tensor], tmp_path: Path
) -> None:
    said = {"pixel_mean": torch.full((3, 1, 1), 99.0), "pixel_std": torch.ones(3, 1, 1)}
    path, out = tmp_path / "said.pth", tmp_path / "ours.safetensors"
    torch.save(weights | said, path)
    stated = ("--stride-in", "1x1", "--anchor-sizes", "32,64,128,256,512")
    stated += ("--anchor-ratios", "0.5,1,2")
    code, printed, told = call("import", path, "--out", out, *stated, "--json")
    assert (code, told) == (0, "")
    assert json.loads(printed)["pixel_mean"] == [99.0] * 3
    assert json.loads(printed)["assumed"] == []


class Hostile:
    def __init__(self, touched: Path) -> None:
        self.touched = touched

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch '{self.touched}'",)


MISTAKES: dict[str, tuple[tuple[object, ...], str]] = {
    "no file": (("{}/none.pth",), "none.pth: no such file"),
    "a folder": (("{}",), "is a folder, expected a .pth or .pkl checkpoint"),
    "hostile": (("{}/hostile.pkl",), "hostile.pkl: refused, it would call "),
    "other network": (("{}/other.pth",), "other.pth: a torchvision detector with backbone.body"),
    "over itself": (
        ("{}/other.pth", "--out", "{}/x/../other.pth"),
        "is the input file",
    ),
    "modality": (("{}/other.pth", "--modality", "x"), "--modality is 'x', expected one of: rgb"),
    "stride": (("{}/other.pth", "--stride-in", "x"), "--stride-in is 'x', expected one of: auto"),
    "anchor sizes": (
        ("{}/other.pth", "--anchor-sizes", "a"),
        "--anchor-sizes is 'a', expected num",
    ),
    "no ratio": (("{}/other.pth", "--anchor-ratios", "1,0"), "--anchor-ratios is '1,0', expected"),
    "option": (("{}/other.pth", "--speed", "9"), "--speed"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_an_error_is_one_line_and_writes_nothing(
    call: Call, mistake: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    touched = tmp_path / "touched"
    (tmp_path / "x").mkdir()
    (tmp_path / "hostile.pkl").write_bytes(pickle.dumps({"model": Hostile(touched)}))
    torch.save({"backbone.body.conv1.weight": torch.ones(2)}, tmp_path / "other.pth")
    before = sorted(tmp_path.iterdir())
    arguments, expected = MISTAKES[mistake]
    code, printed, told = call("import", *(str(a).replace("{}", str(tmp_path)) for a in arguments))
    assert (code, printed) == (2, "")
    assert told.startswith("perceptree: ")
    assert told.count("\n") == 1
    assert expected in told
    assert sorted(tmp_path.iterdir()) == before


def test_detectron2s_weights_arrive_whole(
    call: Call, tmp_path: Path, shared_path: Callable[[str], Path]
) -> None:
    golden = shared_path("golden")
    source = importlib.util.spec_from_file_location("fill_weights", golden / "fill_weights.py")
    assert source is not None
    assert source.loader is not None
    fill_weights = importlib.util.module_from_spec(source)
    source.loader.exec_module(fill_weights)
    shapes = json.loads((golden / "R50_shapes.json").read_text())
    filled = fill_weights.fill(shapes, unit_pixel_std=True)
    path, out = tmp_path / "model_final.pkl", tmp_path / "ours.safetensors"
    with path.open("wb") as file:
        pickle.dump({"model": filled, "__author__": "PercepTree"}, file, protocol=4)
    code, printed, _ = call("import", path, "--out", out, "--json")
    assert code == 0
    assert json.loads(printed)["parameters"] == 61_710_939
    model, record = load_checkpoint(out)
    assert model.spec == make_spec("r50")
    assert not record["training"]["init_only"]
    state = model.state_dict()
    for name, value in filled.items():
        assert torch.equal(state[our_name(name)], torch.from_numpy(value)), name
    assert len(filled) == sum(not name.endswith("num_batches_tracked") for name in state)
