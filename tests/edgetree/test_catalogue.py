"""Models that are found by name."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import edgetree
from edgetree.catalogue import (
    CARD_SCHEMA,
    FOLDERS_VARIABLE,
    KnownModel,
    default_model,
    find_model,
    known_models,
)
from edgetree.errors import InputError

Cli = Callable[..., Any]

ROOT = Path(__file__).parents[2]
LARGER = [ROOT / "models/edge-s-depth.onnx", ROOT / "models/edge-s-rgb.onnx"]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the user's with one model, and its card."""
    path = tmp_path / "models"
    path.mkdir()
    shutil.copy(default_model("depth"), path / "ours.onnx")
    write_card(path / "ours.onnx")
    monkeypatch.setenv(FOLDERS_VARIABLE, str(path))
    return path


def write_card(model: Path, **changed: Any) -> None:
    card = {
        "schema": CARD_SCHEMA,
        "model_sha256": hashlib.sha256(model.read_bytes()).hexdigest(),
        "for": "pine stands",
        "test": {"average_precision": {"boxes": 61.25, "masks": 55.0, "keypoints": None}},
        "speed": {"detect_p50_ms": 31.0},
    }
    model.with_suffix(".json").write_text(json.dumps(card | changed), encoding="utf-8")


def test_the_packaged_models_have_names() -> None:
    names = {model.name: model.path for model in known_models()}
    assert names["edge-n-depth"] == default_model("depth") == find_model("edge-n-depth")
    assert names["edge-n-rgb"] == find_model("rgb")


def test_the_larger_models_are_found_by_name_in_a_checkout_alone() -> None:
    imported_from_checkout = Path(edgetree.__file__).parents[1] == ROOT
    names = {model.name: model.path for model in known_models()}
    for path in LARGER:
        assert names.get(path.stem) == (path if imported_from_checkout else None)


def test_the_larger_models_are_found_with_their_folder_named(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv(FOLDERS_VARIABLE, str(LARGER[0].parent))
    for path in LARGER:
        assert find_model(path.stem) == path


@pytest.mark.parametrize("path", LARGER, ids=lambda path: path.stem)
def test_the_larger_models_have_cards_of_the_very_files(path: Path) -> None:
    card = KnownModel(path.stem, path).card()
    assert card is not None, "run benchmarks/model_cards.py"
    size = [800, 480] if path.stem == "edge-s-depth" else [640, 384]
    assert (card["input_px"], card["test"]["frames"]) == (size, 400)


@pytest.mark.parametrize("modality", ["depth", "rgb"])
def test_the_packaged_models_have_cards_of_the_very_files(modality: str) -> None:
    card = KnownModel(f"edge-n-{modality}", default_model(modality)).card()
    assert card is not None, "run benchmarks/model_cards.py"
    for name in ("test", "field_test"):
        measured = card[name]
        assert measured["frames"] == 400
        assert measured["average_precision"].keys() == {"boxes", "masks", "keypoints"}
        top = measured["reliability"]["bins"][-1]
        assert abs(top["right"] - top["mean_score"]) < 0.05, "scores are not probabilities"
    assert default_model(modality).with_suffix(".md").is_file()


def test_a_folder_of_the_user_comes_first(folder: Path) -> None:
    shutil.copy(default_model("rgb"), folder / "edge-n-rgb.onnx")
    assert find_model("ours") == folder / "ours.onnx"
    assert find_model("edge-n-rgb") == folder / "edge-n-rgb.onnx"
    assert find_model("rgb") == default_model("rgb"), "this is always the package's"


def test_a_path_stays_a_path(tmp_path: Path) -> None:
    assert find_model("of/mine.onnx") == Path("of/mine.onnx")
    assert find_model("mine.onnx") == Path("mine.onnx")


def test_an_unknown_name_lists_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"'edge-x'.*edge-n-depth, edge-n-rgb"):
        find_model("edge-x")


def test_a_missing_folder_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(FOLDERS_VARIABLE, str(tmp_path / "gone"))
    with pytest.raises(InputError, match=r"EDGETREE_MODELS names .*gone"):
        known_models()


@pytest.mark.parametrize(
    ("card", "what"),
    [
        ("{", "cannot be read"),
        ("[]", "another schema"),
        (json.dumps({"schema": "edgetree.card/9"}), "another schema"),
        (json.dumps({"schema": CARD_SCHEMA, "model_sha256": "0"}), "the card of another file"),
    ],
)
def test_a_wrong_card_is_refused(folder: Path, card: str, what: str) -> None:
    (folder / "ours.json").write_text(card, encoding="utf-8")
    with pytest.raises(InputError, match=what):
        KnownModel("ours", folder / "ours.onnx").card()


def test_the_command_lists_names_figures_and_what_they_are_for(run_cli: Cli, folder: Path) -> None:
    done = run_cli("models")
    assert done.code == 0, done.err
    rows = {line.split()[0]: line.split()[1:] for line in done.out.splitlines() if line}
    assert rows["ours"] == ["depth", "int8", "3.9", "61.2", "55.0", "-", "31.0"]
    assert "ours: pine stands" in done.out
    assert rows["edge-n-rgb"][:2] == ["rgb", "int8"]


def test_the_command_leaves_out_what_is_no_model(run_cli: Cli, folder: Path) -> None:
    (folder / "broken.onnx").write_bytes(b"not a model")
    done = run_cli("models", "--json")
    assert done.code == 0
    listed = json.loads(done.out)["models"]
    names = {each["name"] for each in listed}
    assert {"edge-n-depth", "edge-n-rgb", "ours"} <= names
    assert "broken" not in names
    assert "left out" in done.err
    assert "broken.onnx" in done.err


def test_the_model_suits_the_input_and_this_is_told(run_cli: Cli, images: Path) -> None:
    depth = images.parent / "depth"
    for extra, name in (((), "edge-n-rgb"), (("--depth", depth), "edge-n-depth")):
        done = run_cli("run", images, *extra, "--json")
        assert done.code == 0, done.err
        assert json.loads(done.out)["model"]["name"] == name
        images_are = "depth" if extra else "colour"
        told = f"model: {name}.onnx, int8 for {images_are} images, trained on paper, field"
        assert done.err.count(told) == 1
