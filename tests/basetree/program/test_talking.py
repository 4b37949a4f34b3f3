"""What a program prints with --quiet, --verbose and --log-file, before and after the command."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import logging, typer
from basetree.errors import InputError
from basetree.program.command_line import run_app
from basetree.program.console import complain, note, tell
from basetree.program.help import new_app
from basetree.program.options import expand_groups
from basetree.program.talking import TalkOptions

app = new_app("Waters trees.", "water")

@app.callback()
@expand_groups
def options(*, talk: TalkOptions) -> None:
    talk.apply()

@app.command()
def pour(litres: int) -> None:
    note("next: wait")
    complain("left out: a tree")
    logging.getLogger("pump").info("runs")
    logging.getLogger("pump").warning("is hot")
    if litres > 9:
        raise InputError("9 litres are the most")
    tell(f"{litres} litres")

run_app(app, "water")
"""


def water(*words: object) -> tuple[int, str, list[str]]:
    root = str(Path(__file__).resolve().parents[3])
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, *map(str, words)],
        capture_output=True,
        text=True,
        check=False,
        env=os.environ | {"PYTHONPATH": root},
    )
    return done.returncode, done.stdout, done.stderr.splitlines()


def test_by_default_notes_and_warnings_are_printed() -> None:
    assert water("pour", 3) == (0, "3 litres\n", ["next: wait", "left out: a tree", "is hot"])


@pytest.mark.parametrize("words", [("-q", "pour", 3), ("pour", 3, "--quiet")])
def test_a_quiet_program_prints_results_and_errors_only(words: tuple[object, ...]) -> None:
    assert water(*words) == (0, "3 litres\n", ["left out: a tree"])
    code, out, told = water("-q", "pour", 10)
    assert (code, out, told[-1]) == (2, "", "water: 9 litres are the most")


@pytest.mark.parametrize("words", [("-v", "pour", 3), ("pour", 3, "--verbose")])
def test_a_verbose_program_tells_versions_logs_and_time(words: tuple[object, ...]) -> None:
    _, out, told = water(*words)
    assert out == "3 litres\n"
    assert re.match(r"edgetree \S+, .*Python 3\.", told[0])
    assert told[1:5] == ["next: wait", "left out: a tree", "runs", "is hot"]
    assert re.fullmatch(r"water: exit code 0 after \d+ s", told[5])
    _, _, told = water("-v", "pour", 10)
    assert any('raise InputError("9 litres' in line or "in pour" in line for line in told)


def test_the_log_has_all_messages_also_of_a_quiet_program(tmp_path: Path) -> None:
    log = tmp_path / "pour.log"
    log.write_text("older\n")
    assert water("-q", "pour", 10, "--log-file", log)[0] == 2
    lines = log.read_text().splitlines()
    assert all(re.match(r"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d ", line) for line in lines)
    messages = [line[20:] for line in lines]
    assert messages[1:] == [
        "next: wait",
        "left out: a tree",
        "runs",
        "is hot",
        "water: 9 litres are the most",
    ]
    assert (tmp_path / "pour.1.log").read_text() == "older\n"


def test_contradictions_and_logs_that_cannot_be_written_are_one_line(tmp_path: Path) -> None:
    code, _, told = water("-q", "pour", 3, "-v")
    assert (code, told) == (2, ["water: --verbose given with --quiet: expected one of them"])
    code, out, told = water("pour", 3, "--log-file", tmp_path / "none" / "x.log")
    assert (code, out, len(told)) == (2, "", 1)
    assert "x.log" in told[0]
