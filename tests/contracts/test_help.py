"""The help of every command: it fits a terminal, shows an example, and speaks in one style."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer

from edgetree.cli import app as edgetree_app
from perceptree.cli import app as perceptree_app
from perceptree.commands.synth import chosen_preset
from perceptree.training.recipes import RECIPES, recipe_settings

ROOT = Path(__file__).resolve().parents[2]
PROGRAMS = {"edgetree": edgetree_app, "perceptree": perceptree_app}
DEFAULTS_IN_WORDS = re.compile(
    r"\(the default|by default (the|a)\b|if not given|\.\s\[\d+\]$", re.I
)


def contexts(command: Any, name: str, parent: Any = None) -> Iterator[tuple[Any, Any]]:
    """Each command of a program, with its context."""
    context = command.make_context(name, [], parent, resilient_parsing=True)
    yield command, context
    for word, child in getattr(command, "commands", {}).items():
        yield from contexts(child, word, context)


COMMANDS = {
    context.command_path: (command, context)
    for name, app in PROGRAMS.items()
    for command, context in contexts(typer.main.get_command(app), name)
}


@pytest.mark.parametrize("columns", [80, 120])
@pytest.mark.parametrize("path", COMMANDS)
def test_the_help_fits_a_terminal_and_cuts_nothing(
    path: str, columns: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(columns))
    command, context = COMMANDS[path]
    text = command.get_help(context)
    words = " ".join(text.split())
    assert max(map(len, text.splitlines())) <= columns
    assert "..." not in re.sub(r"\w*\.\.\.|http://\.\.\.,|\(s3://\.\.\.\)|,\.\.\.", "", text)
    for child in getattr(command, "commands", {}).values():
        assert " ".join(child.help.partition("\n\n")[0].split()) in words


@pytest.mark.parametrize("path", [path for path in COMMANDS if COMMANDS[path][0].callback])
def test_values_have_names_and_defaults_one_style(path: str) -> None:
    command, context = COMMANDS[path]
    text = command.get_help(context)
    assert not re.search(r"<[\w\[\] ]+>", text)
    for param in command.get_params(context):
        assert not DEFAULTS_IN_WORDS.search(param.help or ""), param.name


@pytest.mark.parametrize("path", COMMANDS)
def test_every_command_shows_an_example_that_it_takes(path: str) -> None:
    command, context = COMMANDS[path]
    if getattr(command, "commands", {}):
        return
    words = shlex.split(command.epilog)
    names = path.split()
    assert words[: len(names)] == names
    command.make_context(path, words[len(names) :], context.parent)
    shown = command.get_help(context).partition("Example:\n")[2]
    assert shlex.split(shown.replace("\\\n", "")) == words


def help_of(path: str, option: str) -> str:
    """The help of one option of a command, with its default, in one line."""
    command, context = COMMANDS[path]
    (param,) = (each for each in command.get_params(context) if option in each.opts)
    return " ".join(param.get_help_record(context)[1].split())


def test_the_help_of_synth_has_the_defaults_that_hold() -> None:
    start = chosen_preset(None)
    assert f"default: ({start.frames}; with --preset" in help_of("perceptree synth", "--frames")
    assert f"default: ({start.seed}; with --preset" in help_of("perceptree synth", "--seed")
    assert f"of field {start.settings.views_per_scene})" in help_of("perceptree synth", "--views")


def test_the_help_of_train_names_what_the_recipe_transfer_changes() -> None:
    usual = recipe_settings("scratch", steps=1)
    for name in RECIPES["transfer"].keys() & {"freeze_level", "frozen_norms", "keep_features"}:
        assert getattr(usual, name) != RECIPES["transfer"][name]
        shown = help_of("perceptree train", f"--{name.replace('_', '-')}")
        assert "with the recipe transfer" in shown


def test_options_stand_in_groups() -> None:
    command, context = COMMANDS["edgetree run"]
    headings = re.findall(r"^([A-Z][\w ]+):$", command.get_help(context), flags=re.MULTILINE)
    assert headings[0] == "Arguments"
    assert {"Model", "Input", "Camera and depth", "Results", "Several machines"} <= set(headings)
    assert headings[-2:] == ["General", "Example"]


def run(program: str, *words: str, **environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", program, *words],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)} | environment,
    )
    return done.stdout


def test_h_is_help() -> None:
    assert run("edgetree", "run", "-h") == run("edgetree", "run", "--help")
    assert run("perceptree", "data", "-h") == run("perceptree", "data")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("edgetree live --model edge", {"edge-n-rgb", "edge-n-depth"}),
        ("edgetree run --dep", {"--depth", "--depth-scale"}),
        ("perceptree data s", {"split", "show"}),
    ],
)
def test_a_shell_completes_commands_options_and_models(words: str, expected: set[str]) -> None:
    program = words.split()[0]
    variable = f"_{program.upper()}_COMPLETE"
    at = str(len(words.split()) - 1)
    bash = {variable: "complete_bash", "COMP_WORDS": words, "COMP_CWORD": at}
    assert expected <= set(run(program, **bash).splitlines())
    fish = {variable: "complete_fish", "_TYPER_COMPLETE_ARGS": words}
    suggested = run(program, _TYPER_COMPLETE_FISH_ACTION="get-args", **fish).splitlines()
    assert {line.partition("\t")[0] for line in suggested} >= expected
    start = words.split()[-1]
    assert all(line.startswith(start) for line in suggested)
