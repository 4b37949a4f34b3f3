"""`perceptree train --modality both`, and the evaluation of what it gives."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from narrow_networks import narrow_spec

from perceptree.models import TreeRCNN, load_checkpoint, save_checkpoint

Call = Callable[..., tuple[int, str, str]]


def write_start(path: Path, modality: str) -> TreeRCNN:
    torch.manual_seed(0)
    model = TreeRCNN(narrow_spec(modality))
    save_checkpoint(path, model, {"data": "posts"})
    return model


def train(call: Call, posts: Path, out: Path, *more: object) -> tuple[int, str, str]:
    options = ("--steps", 2, "--batch", 2, "--workers", 0, "--evaluate-every", 2)
    return call("train", posts, "--out", out, *options, *more)


def test_a_network_of_both_is_trained_from_two_and_evaluated_three_ways(
    posts: Path, tmp_path: Path, call: Call
) -> None:
    files = {each: tmp_path / f"{each}.safetensors" for each in ("depth", "rgb")}
    starts = {each: write_start(path, each) for each, path in files.items()}
    more = ("--init", files["depth"], "--init-colour", files["rgb"], "--freeze-level", 5)
    code, _, told = train(call, posts, tmp_path / "run", *more, "--frozen-norms", "--json")
    assert code == 0, told
    model, record = load_checkpoint(tmp_path / "run/best.safetensors")
    assert (model.spec.modality, model.spec.name) == ("both", "edge-n")
    origin = record["training"]["init"]
    assert (origin["name"], origin["colour"]["name"]) == ("depth.safetensors", "rgb.safetensors")
    assert {"lightness", "median_m"} <= set(record["training"]["pictures"])
    for own, start in zip(model.backbones, starts.values(), strict=True):
        theirs = start.backbone.state_dict()
        assert all(x.equal(theirs[name]) for name, x in own.state_dict().items())
    assert model.colour_lateral is not None
    assert any(parameter.any() for parameter in model.colour_lateral.parameters())
    figures = {}
    for inputs in ("both", "colour", "depth"):
        path = tmp_path / "run/best.safetensors"
        code, told, _ = call("eval", path, posts, "--inputs", inputs, "--json")
        assert code == 0
        figures[inputs] = json.loads(told)["model"]["modality"]
    assert figures == {"both": "both", "colour": "rgb", "depth": "depth"}


def test_it_is_also_trained_from_random_weights_and_goes_on(
    posts: Path, tmp_path: Path, call: Call
) -> None:
    size = ("--height", 64, "--width", 128)
    code, _, told = train(call, posts, tmp_path / "run", "--modality", "both", *size)
    assert code == 0, told
    best = tmp_path / "run/best.safetensors"
    code, _, told = train(call, posts, tmp_path / "more", "--init", best, "--keep-features", 1)
    assert code == 0, told
    assert load_checkpoint(tmp_path / "more/best.safetensors")[0].spec.modality == "both"
    keep = ("--branch", tmp_path / "run", "--keep-features", 1)
    code, _, told = train(call, posts, tmp_path / "branch", "--modality", "both", *size, *keep)
    assert code == 0, told


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--init-colour", "RGB"], "--init is None with --init-colour: expected a checkpoint"),
        (["--init", "RGB", "--init-colour", "RGB"], "are for rgb and rgb, expected depth and rgb"),
        (
            ["--init", "DEPTH", "--init-colour", "RGB", "--modality", "depth"],
            "--modality is depth, but",
        ),
        (
            ["--modality", "both", "--init", "imagenet"],
            "of both inputs are imagenet, expected checkpoints: --init of a depth model",
        ),
        (["--modality", "both", "--model", "r50"], "model is r50 for both: expected one of"),
        (["--modality", "both", "--exact-depth"], "expected no --exact-depth for both"),
    ],
)
def test_what_does_not_fit_is_one_line(
    posts: Path, tmp_path: Path, call: Call, options: list[str], reason: str
) -> None:
    files = {"RGB": "rgb", "DEPTH": "depth"}
    for name, modality in files.items():
        write_start(tmp_path / f"{name}.safetensors", modality)
    given = [tmp_path / f"{each}.safetensors" if each in files else each for each in options]
    code, _, told = train(call, posts, tmp_path / "run", *given)
    assert code == 2
    assert reason in told.replace("\n", " ")
    assert "Traceback" not in told
