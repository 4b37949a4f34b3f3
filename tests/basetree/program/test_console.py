"""Lines of strangers do nothing to a terminal or a log, whoever prints them."""

from __future__ import annotations

import logging
import os
import subprocess
import sys

import pytest

from basetree.errors import one_line, short_line
from basetree.program.console import (
    BAR_STREAM,
    LogNotes,
    complain,
    keep_remarks,
    note,
    note_remarks,
    print_found,
    tell,
)

HOSTILE = {
    "line break": "a\nFAKE",
    "carriage return": "a\rFAKE",
    "title of the window": "a\x1b]0;owned\x07",
    "cleared screen": "a\x1b[2J",
    "C1 control": "a\x9b2J",
    "next line": "a\x85FAKE",
    "line separator": "a\u2028FAKE",
    "direction of writing": "a\u202egpj.exe",
    "isolated direction": "a\u2066gpj\u2069",
    "invisible": "a\u200b\ufeff\u00adb",
    "surrogate": "a\ud800b",
    "zero": "a\0b",
    "tag": "a\U000e0041b",
}


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_every_line_is_printed_as_one_clean_line(
    capsys: pytest.CaptureFixture[str], text: str
) -> None:
    note(text)
    tell(text)
    print_found(False, dict, lambda: [text])
    log = logging.Logger("of-a-stranger")  # none of pytest's, which could not send the texts
    handler = LogNotes()
    log.addHandler(handler)
    log.warning("%s", text)
    log.removeHandler(handler)
    printed = capsys.readouterr()
    for lines in (printed.out.split("\n"), printed.err.split("\n")):
        assert len(lines) == 3
        assert lines[2] == ""
        assert all(line.isprintable() and line.startswith("a ") for line in lines[:2])


@pytest.mark.parametrize("text", ["Fichte – ±0,5 °", "מדידה", "木.jpg", "name\udcff", "a  b"])
def test_texts_of_all_languages_and_names_that_are_not_utf8_are_kept(text: str) -> None:
    assert one_line(text) == short_line(text) == text


PROGRAM = """
import logging, sys, warnings
from basetree.program.process import run_command_line
def run():
    logging.getLogger("a.library").warning("%s", {text!r})
    raise {error}
run_command_line("program", run)
"""


@pytest.mark.parametrize(
    ("error", "code"),
    [
        ("ValueError({text!r})", 1),
        ("OSError(2, 'No such file', {text!r})", 2),
        ("__import__('basetree.errors').errors.InputError({text!r})", 2),
    ],
)
def test_logs_and_errors_of_a_program_are_clean(error: str, code: int) -> None:
    text = "\x1b[2J\x9b\u202e" + "name"
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(text=text, error=error.format(text=text))],
        capture_output=True,
        check=False,
        env=os.environ | {"PYTHONUTF8": "1"},
    )
    assert done.returncode == code
    lines = done.stderr.decode().split("\n")
    assert all(line.isprintable() for line in lines)
    assert sum("name" in line for line in lines if "raise" not in line) >= 2


def test_a_progress_bar_outlives_its_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    class Dead:
        def write(self, text: str) -> int:
            raise OSError(5, "Input/output error")

        def flush(self) -> None:
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(sys, "stderr", Dead())
    assert BAR_STREAM.write("50 %") == 4
    BAR_STREAM.flush()


def test_remarks_come_after_the_results(capsys: pytest.CaptureFixture[str]) -> None:
    record = logging.LogRecord("edgetree", logging.WARNING, "", 0, "a remark", (), None)
    warning = logging.LogRecord("edgetree", logging.WARNING, "", 0, "a warning", (), None)
    record.is_remark = True
    keep_remarks()
    for each in (record, warning):
        LogNotes().emit(each)
    note("the results")
    note_remarks()
    assert capsys.readouterr().err.splitlines() == ["a warning", "the results", "a remark"]
    LogNotes().emit(record)  # of a command that keeps none
    note_remarks()
    assert capsys.readouterr().err.splitlines() == ["a remark"]


def test_a_narrow_terminal_shows_whole_words(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "24")
    words = "depth of several stems is missing in a_very_long_name_of_a_file.png"
    note(words)
    assert capsys.readouterr().err == f"{words}\n"  # a file or a pipe gets one line
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    complain(words)
    lines = capsys.readouterr().err.splitlines()
    assert " ".join(line.strip() for line in lines) == words
    assert [len(line) <= 24 for line in lines] == [True] * (len(lines) - 1) + [False]
    note(words, whole=True)
    assert capsys.readouterr().err == f"{words}\n"


def test_results_are_broken_below_their_text_and_commands_are_not(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    lines = [
        "  mean error    0.8 cm; in the long run -2.1 to 6.8 % of the diameter",
        "    operators: RoiAlign 13.3, QLinearConv 10.6, Resize 2.3",
        "next: edgetree run samples/pictures --depth samples/depth",
    ]
    print_found(False, dict, lambda: lines)
    assert capsys.readouterr().out.splitlines() == lines  # a file or a pipe gets whole lines
    monkeypatch.setattr(sys.stdout, "isatty", lambda: True, raising=False)
    print_found(False, dict, lambda: lines)
    assert capsys.readouterr().out.splitlines() == [
        "  mean error    0.8 cm; in the long run",
        "                -2.1 to 6.8 % of the",
        "                diameter",
        "    operators: RoiAlign 13.3,",
        "      QLinearConv 10.6, Resize 2.3",
        lines[2],
    ]
