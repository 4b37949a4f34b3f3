"""Cards beside models that people edited, or that come from strangers."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from edgetree.catalogue import FOLDERS_VARIABLE, default_model
from edgetree.commands.bench_accuracy import accuracy_of
from edgetree.model_file.card import CARD_SCHEMA

Cli = Callable[..., Any]


@pytest.fixture
def model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A model in a folder of the user's."""
    path = tmp_path / "models" / "ours.onnx"
    path.parent.mkdir()
    shutil.copy(default_model("depth"), path)
    monkeypatch.setenv(FOLDERS_VARIABLE, str(path.parent))
    return path


def card_of(model: Path, **changes: Any) -> str:
    card = {
        "schema": CARD_SCHEMA,
        "model_sha256": hashlib.sha256(model.read_bytes()).hexdigest(),
        "for": "pine stands",
        "test": {"average_precision": {"boxes": 61.2, "masks": None, "keypoints": 50}},
        "speed": {"detect_p50_ms": 31.0},
    }
    return json.dumps(card | changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"test": []}, "test is a list of 0 items, expected an object"),
        (
            {"test": {"average_precision": {"boxes": 3}}},
            "test.average_precision has no field 'masks'",
        ),
        ({"speed": {"detect_p50_ms": "3"}}, "speed.detect_p50_ms is '3', expected a number or nul"),
        ({"speed": {"detect_p50_ms": -1}}, "speed.detect_p50_ms is -1, expected a number of at"),
        ({"for": 5}, "for is 5, expected text"),
    ],
)
def test_a_model_with_a_wrong_card_is_listed_without_figures(
    run_cli: Cli, model: Path, changes: dict[str, Any], message: str
) -> None:
    card = model.with_suffix(".json")
    card.write_text(card_of(model, **changes))
    done = run_cli("models")
    assert done.code == 0
    assert f"no figures of {model.stem}: {card}: {message}" in done.err
    assert model.stem in done.out
    assert accuracy_of(model, None, "test") is None


@pytest.mark.parametrize("text", ["[" * 100_000, '{"a":' * 100_000, "{", "[]", " " * 2**22])
def test_a_model_with_another_text_for_a_card_is_listed_without_figures(
    run_cli: Cli, model: Path, text: str
) -> None:
    model.with_suffix(".json").write_text(text)
    done = run_cli("models")
    assert done.code == 0
    assert f"no figures of {model.stem}: {model.with_suffix('.json')}" in done.err
    assert model.stem in done.out
    assert "Traceback" not in done.err


def test_texts_of_a_card_cannot_steer_the_terminal(run_cli: Cli, model: Path) -> None:
    model.with_suffix(".json").write_text(card_of(model, **{"for": "\x1b]0;t\x07\x1b[31mred\n"}))
    done = run_cli("models")
    assert "red" in done.out
    assert "\x1b" not in done.out
    assert "\x07" not in done.out


def test_a_card_without_figures_of_metres_gives_no_accuracy(model: Path) -> None:
    model.with_suffix(".json").write_text(card_of(model))
    assert accuracy_of(model, None, "test") is None
    packaged = accuracy_of(default_model("depth"), None, "test")
    assert packaged is not None
    assert packaged["diameter_error_mm"] > 0
