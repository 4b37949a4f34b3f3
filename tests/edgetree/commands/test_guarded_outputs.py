"""An output that fails stops alone, is counted, and is tried again where that helps."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import pytest
from file_limits import largest_file

from basetree.errors import CheckFailed, InputError
from edgetree.commands import guarded_outputs
from edgetree.commands.guarded_outputs import GuardedOutputs
from edgetree.results.csv_table import Table
from edgetree.sinks import CsvSink


def error_of(number: int) -> OSError:
    return OSError(number, os.strerror(number))


class Output:
    """An output in memory, whose disk fails while `fault` is set."""

    def __init__(self, *, goes_on: bool = True, appears_whole: bool = False) -> None:
        self.goes_on, self.appears_whole = goes_on, appears_whole
        self.got: list[Any] = []
        self.fault: BaseException | None = None
        self.is_closed = False
        self.opened = 0

    def make(self) -> Output:
        if self.fault is not None:
            raise self.fault
        self.opened += 1
        return self

    def write(self, result: Any) -> None:
        if self.fault is not None:
            raise self.fault
        self.got.append(result)

    def close(self) -> None:
        self.is_closed = True


def opened(*outputs: Output, others: bool = False) -> GuardedOutputs:
    guarded = GuardedOutputs(others=others)
    for number, output in enumerate(outputs):
        guarded.open(f"--out{number}", output.make, waits=True)
    return guarded


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EPIPE])
def test_the_same_file_goes_on_when_there_is_space(
    capsys: pytest.CaptureFixture[str], number: int
) -> None:
    full, other = Output(), Output()
    guarded = opened(full, other)
    for result in range(6):
        full.fault = error_of(number) if 2 <= result < 5 else None
        guarded.write(result)
    guarded.close()
    assert (full.got, other.got) == ([0, 1, 5], list(range(6)))
    assert (full.opened, full.is_closed, other.is_closed) == (1, True, True)
    reason = os.strerror(number)
    assert capsys.readouterr().err.splitlines() == [
        f"--out0: {reason}: it is tried again, and the other outputs go on",
        "--out0 is written again, without 3 frames",
    ]
    with pytest.raises(CheckFailed, match=rf"--out0 lacks 3 of 6 frames \({reason}\)"):
        guarded.check()


@pytest.mark.parametrize("number", [errno.EIO, errno.ENODEV, errno.EROFS])
def test_a_disk_that_is_gone_is_opened_again_now_and_then(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    now_s = 0.0
    monkeypatch.setattr(guarded_outputs.time, "monotonic", lambda: now_s)
    gone, other = Output(), Output()
    guarded = opened(gone, other)
    for result in range(50):
        now_s = float(result)
        gone.fault = error_of(number) if 5 <= result < 12 or result == 40 else None
        guarded.write(result)
    assert gone.got == [*range(5), *range(20, 40), *range(41, 50)]
    assert gone.opened == 3
    assert other.got == [*range(50)]


def test_a_disk_that_fails_at_the_start_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = 100.0
    monkeypatch.setattr(guarded_outputs.time, "monotonic", lambda: now_s)
    full, other = Output(), Output()
    full.fault = error_of(errno.ENOSPC)
    guarded = opened(full, other)
    guarded.write(0)
    full.fault, now_s = None, 111.0
    guarded.write(1)
    assert (full.got, other.got) == ([1], [0, 1])


@pytest.mark.parametrize("error", [error_of(errno.ENOENT), error_of(errno.EACCES), InputError("x")])
def test_a_mistake_at_the_start_is_not_waited_for(error: Exception) -> None:
    wrong = Output()
    wrong.fault = error
    with pytest.raises(type(error)):
        opened(Output(), wrong)


def test_an_output_that_cannot_go_on_is_given_up(capsys: pytest.CaptureFixture[str]) -> None:
    lost, other = Output(goes_on=False, appears_whole=True), Output()
    guarded = opened(lost, other)
    lost.fault = error_of(errno.ENOSPC)
    guarded.write(0)
    lost.fault = None
    guarded.write(1)
    assert (lost.got, lost.is_closed, other.got) == ([], True, [0, 1])
    assert not guarded.holds("--out0")
    assert guarded.holds("--out1")
    assert capsys.readouterr().err.count("\n") == 1
    assert guarded.missing() == ["--out0 is not written (No space left on device)"]


def test_the_last_output_that_is_lost_ends_the_command(capsys: pytest.CaptureFixture[str]) -> None:
    only = Output(goes_on=False)
    guarded = opened(only)
    only.fault = fault = error_of(errno.EPIPE)
    with pytest.raises(BrokenPipeError) as raised:
        guarded.write(0)
    assert raised.value is fault
    assert capsys.readouterr().err == ""
    only = Output(goes_on=False)
    guarded = opened(only, others=True)
    only.fault = fault
    guarded.write(0)  # as a page gets the results too


def test_other_errors_are_not_kept_back() -> None:
    wrong, other = Output(), Output()
    guarded = opened(wrong, other)
    for error in (InputError("no poses"), ValueError("a bug")):
        wrong.fault = error
        with pytest.raises(type(error)):
            guarded.write(0)


def test_an_error_of_a_library_behind_ours_counts_as_the_disk() -> None:
    wrong, other = Output(), Output()
    guarded = opened(wrong, other)
    wrong.fault = InputError("bag cannot be written")
    wrong.fault.__cause__ = error_of(errno.ENOSPC)
    guarded.write(0)
    assert guarded.missing() == ["--out0 lacks 1 of 1 frame (No space left on device)"]


def test_one_output_that_cannot_be_completed_keeps_no_other_from_it() -> None:
    class Stubborn(Output):
        def close(self) -> None:
            raise error_of(errno.ENOSPC)

    first, stubborn, last = Output(), Stubborn(appears_whole=True, goes_on=False), Output()
    guarded = opened(first, stubborn, last)
    with guarded:
        guarded.write(0)
    assert (first.is_closed, last.is_closed) == (True, True)
    assert guarded.missing() == ["--out1 is not written (No space left on device)"]


def test_a_table_on_a_full_disk_has_whole_rows_and_its_header(tmp_path: Path) -> None:
    table: Table[Any] = Table(("number",), lambda number: [{"number": number}])
    path = tmp_path / "a.csv"
    guarded = GuardedOutputs(others=True)
    guarded.open("--csv", lambda: CsvSink(path, table, grows=True))
    with largest_file(4):
        guarded.write(1)
    for number in (2, 3):
        guarded.write(number)
    with largest_file(path.stat().st_size + 2):
        guarded.write(44444)
    guarded.write(5)
    guarded.close()
    assert path.read_text().split() == ["number", "2", "3", "5"]


def test_messages_that_a_controller_did_not_get_are_among_what_is_lacking() -> None:
    """As while a broker is away for an hour, which is no fault of the output."""

    class Controller(Output):
        lost = 0

        def write(self, result: Any) -> None:
            self.lost += result > 1

    guarded = opened(Controller(), Output())
    for result in range(6):
        guarded.write(result)
    assert guarded.lacking() == {"--out0": 4, "--out1": 0}
    assert guarded.missing() == []
    guarded.check()
