"""The recipes of the shipped models: every command can be typed, and a run goes on where it was."""

import argparse
import importlib
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import typer

from edgetree import TreeDetector
from edgetree.catalogue import KnownModel
from edgetree.cli import app as edgetree_app
from perceptree.cli import app as perceptree_app
from perceptree.models import load_checkpoint
from release.make import RecipeError, make, names, read_recipe, small

ROOT = Path(__file__).resolve().parents[2]
CARDS = sorted(
    [*(ROOT / "edgetree/assets/models").glob("*.json"), *(ROOT / "models").glob("*.json")]
)
PROGRAMS = {
    "edgetree": typer.main.get_command(edgetree_app),
    "perceptree": typer.main.get_command(perceptree_app),
}
VALUES = {"RECIPES": str(ROOT / "release/recipes"), "TEXTURES": "photographs"}
NOT_SHIPPED = ("edge-n-depth-cameras",)
COMMANDS = [
    (name, number, words)
    for name in names()
    for number, words in enumerate(read_recipe(name, VALUES), 1)
]


class Parsed(Exception):
    """A program has read its command line."""


def check_command(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Parse a command as its program does; raises for a wrong command, option or value."""
    if words[0] in PROGRAMS:
        command: Any = PROGRAMS[words[0]]
        command.commands[words[1]].make_context(" ".join(words[:2]), list(words[2:]))
        return
    assert words[:2] == ["python", "-m"], words
    read = argparse.ArgumentParser.parse_args

    def parse(self: argparse.ArgumentParser) -> None:
        read(self, words[3:])
        raise Parsed

    program = importlib.import_module(words[2])
    with monkeypatch.context() as patched:
        patched.setattr(argparse.ArgumentParser, "parse_args", parse)
        with pytest.raises(Parsed):
            program.main()


@pytest.mark.parametrize(
    ("name", "number", "words"), COMMANDS, ids=[f"{each[0]}-{each[1]}" for each in COMMANDS]
)
def test_a_command_exists_with_its_options(
    name: str, number: int, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    check_command(words, monkeypatch)
    check_command(small(words), monkeypatch)
    if "--settings" in words:
        assert Path(words[words.index("--settings") + 1]).is_file()


@pytest.mark.parametrize("words", [["perceptree", "train", "data", "--no-such-option"]])
def test_a_wrong_option_is_seen(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Exception, match="no-such-option"):
        check_command(words, monkeypatch)
    with pytest.raises(SystemExit):
        check_command(["python", "-m", "release.half", "--no-such-option"], monkeypatch)


def test_every_shipped_model_has_a_recipe_that_trains_in_steps() -> None:
    assert {path.stem for path in CARDS} <= set(names())
    for name, _, words in COMMANDS:
        if words[:2] == ["perceptree", "train"]:
            assert "--steps" in words, name
            assert "--minutes" not in words, name


def test_what_a_command_needs_an_earlier_one_has_made() -> None:
    made: set[str] = set()
    for name, number, words in COMMANDS:
        if number == 1:
            made = set()
        if words[:3] == ["python", "-m", "release.make"]:
            first = words[-1]
            made |= {
                path for other, _, each in COMMANDS if other == first for path in results(each)
            }
        needed = [word for word in words if word.startswith(("data/", "runs/", "models/"))]
        for path in needed:
            if path not in results(words):
                assert path in made or path.removesuffix("/best.safetensors") in made, (name, words)
        made |= results(words)


def results(words: list[str]) -> set[str]:
    """What a command makes."""
    made = {words[words.index("--out") + 1]} if "--out" in words else set()
    if words[2] == "release.scenes":
        made.add(words[3])
    return made


def test_the_recipes_simulate_the_seeds_of_the_cards() -> None:
    simulated = {
        int(words[words.index("--seed") + 1])
        for name, _, words in COMMANDS
        if words[1] == "synth" and "--seed" in words and name not in NOT_SHIPPED
    }
    told = {
        entry["seed"] for path in CARDS for entry in json.loads(path.read_text())["training_scenes"]
    }
    assert simulated == told


def test_a_run_goes_on_after_the_last_command_that_ended_well(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.json").write_text("{}")
    tool = ["python", "-m", "json.tool"]
    commands = [[*tool, "a.json", "b.json"], [*tool, "c.json"]]
    assert make("some", commands, tmp_path) != 0
    (tmp_path / "b.json").unlink()
    (tmp_path / "c.json").write_text("{}")
    assert make("some", commands, tmp_path) == 0
    assert not (tmp_path / "b.json").exists(), "it was made before"
    commands[0] = [*tool, "--compact", "a.json", "b.json"]
    assert make("some", commands, tmp_path) == 0
    assert (tmp_path / "b.json").exists(), "the command has changed"
    assert "some, 2 of 2: python -m json.tool c.json" in capsys.readouterr().out


def test_what_is_missing_is_told_in_one_line() -> None:
    with pytest.raises(RecipeError, match="colour needs --textures: expected a folder"):
        read_recipe("colour", {"RECIPES": ""})
    with pytest.raises(RecipeError, match="no recipe is called 'edge-x'"):
        read_recipe("edge-x", VALUES)


def test_a_dry_run_prints_the_commands_and_runs_none(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "release.make", "edge-s-depth", "--dry-run"]
    done = subprocess.run(
        [*command, "--work", str(tmp_path / "none")],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    lines = done.stdout.splitlines()
    assert lines[0] == "python -m release.make edge-n-depth"
    assert len(lines) == len(read_recipe("edge-s-depth", VALUES))
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
def test_a_small_run_makes_a_model_with_its_card(tmp_path: Path) -> None:
    """From frames to the card; the model that the recipe begins with is there already."""
    (tmp_path / "models").mkdir()
    shutil.copy(ROOT / "checkpoints/edge-n-depth.safetensors", tmp_path / "models")
    shutil.copy(ROOT / "edgetree/assets/models/edge-n-depth.json", tmp_path / "models")
    (tmp_path / "edge-s-depth.done").write_text("python -m release.make edge-n-depth --small\n")
    command = [sys.executable, "-m", "release.make", "edge-s-depth", "--small"]
    done = subprocess.run([*command, "--work", str(tmp_path)], cwd=ROOT, check=False)
    assert done.returncode == 0
    path = tmp_path / "models/edge-s-depth.onnx"
    assert TreeDetector.load(path, threads=1).manifest.input.width == 800
    card = KnownModel(path.stem, path).card()
    assert card is not None
    assert card["test"]["frames"] == 6
    assert {907, 909} <= {entry["seed"] for entry in card["training_scenes"]}
    page = path.with_suffix(".md").read_text("utf-8")
    assert re.search(r"^\| training \| paper-907 \| 907 \| 3 \| 6 \|$", page, flags=re.MULTILINE)
    half, _ = load_checkpoint(tmp_path / "checkpoints/edge-s-depth.safetensors")
    assert half.spec.width == 800
