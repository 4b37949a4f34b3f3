"""Models that are found by name."""

from __future__ import annotations

import hashlib
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from both_model import write_both_model

from basetree.errors import InputError
from edgetree import TreeDetector, catalogue
from edgetree.catalogue import (
    DEFAULTS,
    FOLDERS_VARIABLE,
    MODALITIES,
    KnownModel,
    default_model,
    find_model,
    hidden_models,
    known_models,
    other_model,
    suited_model,
)
from edgetree.errors import ModelFileError
from edgetree.model_file.card import CARD_SCHEMA

Cli = Callable[..., Any]

PACKAGED = ["edge-n-depth", "edge-n-rgb", "edge-s-depth", "edge-s-rgb"]


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
    for name in PACKAGED:
        assert names[name] == default_model(name) == find_model(name)
    for modality, name in DEFAULTS.items():
        assert names[name] == default_model(modality) == find_model(modality)
    assert suited_model(with_depth=True) == "edge-n-depth"


def test_a_packaged_model_of_both_suits_what_has_depth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_both_model(tmp_path / "edge-n.onnx")
    monkeypatch.setattr(catalogue, "_PACKAGED", tmp_path)
    assert suited_model(with_depth=True) == "edge-n"
    assert suited_model(with_depth=False) == "edge-s-rgb"
    assert other_model("both", "edge-n") is None
    assert TreeDetector.load("edge-n", threads=1).manifest.takes_both


@pytest.mark.parametrize("name", PACKAGED)
def test_a_name_ends_with_the_images_that_the_file_takes(name: str) -> None:
    assert KnownModel(name, default_model(name)).manifest().modality == name.rpartition("-")[2]


def test_a_detector_opens_by_name() -> None:
    detector = TreeDetector.load("edge-s-rgb", threads=1)
    assert detector.session.name == str(default_model("edge-s-rgb"))
    with pytest.raises(ModelFileError, match="no model is called 'edge-x-rgb'"):
        TreeDetector.load("edge-x-rgb")


@pytest.mark.parametrize("name", PACKAGED)
def test_the_packaged_models_have_cards_of_the_very_files(name: str) -> None:
    card = KnownModel(name, default_model(name)).card()
    assert card is not None, "run release/cards.py"
    assert card["input_px"] == ([800, 480] if name.startswith("edge-s") else [640, 384])
    for test_set in ("test", "field_test"):
        measured = card[test_set]
        assert measured["frames"] == 400
        assert measured["average_precision"].keys() == {"boxes", "masks", "keypoints"}
        top = measured["reliability"]["bins"][-1]
        # Scores of colour files are meant for real pictures, in which trees do not end at 10 m.
        limit = 0.12 if name.endswith("rgb") else 0.05
        assert abs(top["right"] - top["mean_score"]) < limit, "scores are not probabilities"
    assert default_model(name).with_suffix(".md").is_file()


def test_the_page_of_the_models_names_the_defaults() -> None:
    page = default_model("rgb").with_name("README.md").read_text(encoding="utf-8")
    told = re.findall(r"^\| `([\w-]+)` \|.*`(rgb|depth)` stands for it", page, flags=re.MULTILINE)
    assert {modality: name for name, modality in told} == DEFAULTS


def test_a_name_of_the_package_is_the_packages_and_this_is_told(run_cli: Cli, folder: Path) -> None:
    hidden = folder / "edge-n-rgb.onnx"
    shutil.copy(default_model("depth"), hidden)
    assert find_model("ours") == default_model("ours") == folder / "ours.onnx"
    assert find_model("edge-n-rgb").parent == default_model("rgb").parent
    assert find_model(str(hidden)) == hidden
    assert [model.path for model in hidden_models()] == [hidden]
    assert run_cli("models").err.count(f"left out: {hidden}: edge-n-rgb is an earlier model") == 1


def test_the_first_of_the_users_folders_counts(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "work" / "models").mkdir(parents=True)
    for name in ("ours.onnx", "mine.onnx"):
        shutil.copy(folder / "ours.onnx", tmp_path / "work" / "models" / name)
    monkeypatch.chdir(tmp_path / "work")
    assert find_model("ours") == folder / "ours.onnx"
    assert find_model("mine") == tmp_path / "work" / "models" / "mine.onnx"


def test_a_file_of_the_checkout_around_here_is_found(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(FOLDERS_VARIABLE)
    (tmp_path / "docs").mkdir()
    monkeypatch.chdir(tmp_path / "docs")
    with pytest.raises(ModelFileError, match="no model is called 'ours'"):
        find_model("ours")
    (tmp_path / "edgetree").mkdir()
    for file in ("pyproject.toml", "edgetree/catalogue.py"):
        (tmp_path / file).touch()
    assert find_model("ours") == folder / "ours.onnx"


def test_names_work_in_a_folder_that_was_removed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    assert set(PACKAGED) <= {model.name for model in known_models()}


def test_a_path_stays_a_path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert find_model("of/mine.onnx") == Path("of/mine.onnx")
    assert find_model("mine.onnx") == Path("mine.onnx")
    monkeypatch.chdir(tmp_path)
    (tmp_path / "edge-n-depth").mkdir()
    assert find_model("edge-n-depth") == default_model("edge-n-depth"), "a folder is no model"


def test_a_name_may_have_a_dot(folder: Path) -> None:
    (folder / "ours.onnx").rename(folder / "ours-7.1.onnx")
    assert find_model("ours-7.1") == folder / "ours-7.1.onnx"


@pytest.mark.parametrize(
    ("name", "close"),
    [("edge-s-rbg", "edge-s-rgb"), ("Edge-N-Depth", "edge-n-depth"), ("dept", "depth")],
)
def test_an_unknown_name_tells_the_closest_and_all(name: str, close: str) -> None:
    with pytest.raises(ModelFileError) as raised:
        find_model(name)
    told = str(raised.value)
    assert told.startswith(f"no model is called '{name}' (did you mean {close}?): expected a file")
    assert "\n" not in told
    assert all(known in told for known in (*PACKAGED, *MODALITIES))


def test_an_unknown_name_tells_a_file_here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelFileError, match="'larch': expected a file or depth, edge-n-depth"):
        find_model("larch")
    (tmp_path / "larch.onnx").touch()
    with pytest.raises(ModelFileError, match=r"'larch' \(did you mean larch\.onnx\?\)"):
        find_model("larch")


def test_another_model_for_the_same_images() -> None:
    assert other_model("depth", "edge-n-depth") == "edge-s-depth"
    assert other_model("depth", "edge-s-depth") == "edge-n-depth"
    assert {other_model("rgb", name) for name in ("edge-n-rgb", "edge-s-rgb")} == {
        "edge-n-rgb",
        "edge-s-rgb",
    }
    assert other_model("rgb", "fine-tuned") == DEFAULTS["rgb"]


def test_a_missing_folder_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv(FOLDERS_VARIABLE, str(tmp_path / "gone"))
    with pytest.raises(InputError, match=r"EDGETREE_MODELS names .*gone"):
        known_models()


@pytest.mark.parametrize(
    ("card", "what"),
    [
        ("{", "cannot be read"),
        ("[]", "has the schema 'list'"),
        (json.dumps({"schema": "edgetree.card/9"}), "has the schema 'edgetree.card/9'"),
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
    assert set(PACKAGED) <= rows.keys()
    assert rows["edge-n-rgb"][:2] == ["rgb", "int8"]
    assert f"rgb: {DEFAULTS['rgb']}, the default for images without depth" in done.out


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


def test_the_command_lists_a_model_whose_card_is_of_another_file(
    run_cli: Cli, folder: Path
) -> None:
    shutil.copy(default_model("edge-s-depth"), folder / "ours.onnx")
    done = run_cli("models", "--json")
    assert done.code == 0, done.err
    (ours,) = (each for each in json.loads(done.out)["models"] if each["name"] == "ours")
    assert ours["card"] is None
    assert "no figures of ours: " in done.err
    assert "the card of another file than ours.onnx" in done.err


def test_the_model_suits_the_input_and_this_is_told(run_cli: Cli, images: Path) -> None:
    depth = images.parent / "depth"
    for extra, name in (((), DEFAULTS["rgb"]), (("--depth", depth), DEFAULTS["depth"])):
        done = run_cli("run", images, *extra, "--json")
        assert done.code == 0, done.err
        assert json.loads(done.out)["model"]["name"] == name
        images_are = "depth" if extra else "colour"
        told = f"model: {name}.onnx, int8 for {images_are} images, trained on paper, field"
        assert done.err.count(told) == 1
