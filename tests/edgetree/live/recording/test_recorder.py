"""What is recorded around marks, and what happens if memory, disk or time run out."""

from __future__ import annotations

import dataclasses
import itertools
import json
import shutil
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from file_limits import largest_file

from basetree.errors import InputError
from edgetree.frames import Rig
from edgetree.live.recording import FrameRecorder, recorder, run_record
from edgetree.live.recording.file import RecordingFile
from edgetree.live.recording.queue import FrameQueue
from edgetree.runtime import default_model
from edgetree.sources import open_live_source

PATIENCE_S = 60.0
FRAME_BYTES = 64 * 48 * 3


def numbers(folder: Path) -> list[int]:
    """Numbers of the frames of a recording; their stamps are 100 s and tenths."""
    return [round((frame.time_s - 100) * 10) for frame in open_live_source(str(folder))]


def warned(caplog: pytest.LogCaptureFixture) -> list[str]:
    """What was logged about recordings that are written."""
    ours = "edgetree.live.recording"
    return [one.message for one in caplog.records if one.name.startswith(ours)]


def feed(recorder: FrameRecorder, result, first: int, end: int) -> None:
    for number in range(first, end):
        recorder.write(result(number))


def test_the_seconds_around_a_mark_are_recorded(record, recordings, result, said) -> None:
    one = record(before_s=2.0, after_s=1.0, waits=True, about={"schema": "edgetree.recording/1"})
    feed(one, result, 0, 40)
    assert one.mark("wrong diameter") == pytest.approx(2.0)
    feed(one, result, 40, 80)
    one.close()
    (folder,) = recordings()
    assert folder.name.startswith("mark_")
    assert numbers(folder) == list(range(19, 50))
    (about,) = said(folder, "/edgetree/recording")
    assert (about["schema"], about["frames"], about["left_out"]) == ("edgetree.recording/1", 31, 0)
    (mark,) = about["marks"]
    assert (mark["text"], mark["frame"], mark["time_s"]) == ("wrong diameter", 39, 103.9)
    assert [line["frame"] for line in said(folder, "/edgetree/json")] == list(range(19, 50))
    assert one.status.written == 1


def test_without_a_mark_nothing_is_written(record, recordings, result) -> None:
    one = record()
    feed(one, result, 0, 30)
    one.close()
    assert recordings() == []


def test_marks_within_the_seconds_extend_the_recording(record, recordings, result, said) -> None:
    one = record(before_s=0.5, after_s=1.0, waits=True)
    feed(one, result, 0, 10)
    one.mark("first")
    feed(one, result, 10, 18)
    one.mark("second")
    feed(one, result, 18, 60)
    one.close()
    (folder,) = recordings()
    assert numbers(folder) == list(range(4, 28))
    marks = said(folder, "/edgetree/recording")[0]["marks"]
    assert [mark["text"] for mark in marks] == ["first", "second"]


def test_a_mark_after_the_end_makes_a_whole_recording_of_its_own(
    record, recordings, result
) -> None:
    one = record(before_s=1.0, after_s=0.5, waits=True)
    feed(one, result, 0, 20)
    one.mark()
    feed(one, result, 20, 30)
    wait_until(lambda: one.status.written == 1)
    one.mark()
    feed(one, result, 30, 50)
    one.close()
    assert [numbers(folder) for folder in recordings()] == [
        list(range(9, 25)),
        list(range(19, 35)),
    ]


def wait_until(is_true) -> None:
    pause = threading.Event()
    for _ in range(round(PATIENCE_S / 0.01)):
        if is_true():
            return
        pause.wait(0.01)
    pytest.fail("it did not happen")


def test_memory_is_bounded_and_said_once(record, recordings, result, caplog) -> None:
    one = record(before_s=60.0, max_mib=1, waits=True)
    fitting = 2**20 // FRAME_BYTES
    feed(one, result, 0, 300)
    kept_s = one.mark()
    assert kept_s == pytest.approx((fitting - 1) / 10)
    one.close()
    assert numbers(recordings()[0]) == list(range(300 - fitting, 300))
    (line,) = warned(caplog)
    assert line.startswith("1 MiB hold the frames of 11.3 s")


def test_the_depth_of_beams_counts_as_memory_twice(result) -> None:
    """A scanner's frame has its depth with and without the gaps between the beams."""
    queue = FrameQueue(60.0, 2.0, everything=False, max_mib=1, waits=False)
    depth_m = np.ones((256, 256), np.float32)  # a quarter of the limit
    for number in range(10):
        one = result(number, depth_m=depth_m)
        frame = dataclasses.replace(one.frame, filled_depth_m=depth_m)
        queue.put(dataclasses.replace(one, frame=frame))
    assert len(list(queue._kept)) == 2


def test_a_camera_is_not_kept_waiting_and_what_is_missing_is_said(
    record, recordings, result, said, caplog, monkeypatch
) -> None:
    gate = threading.Event()
    original = RecordingFile.add

    def add(self: RecordingFile, result) -> None:
        assert gate.wait(PATIENCE_S)
        original(self, result)

    monkeypatch.setattr(RecordingFile, "add", add)
    one = record(before_s=60.0, after_s=60.0, max_mib=1)
    one.mark()
    feed(one, result, 0, 300)  # more than fit into memory, while the disk takes none
    gate.set()
    wait_until(lambda: one.status.left_out > 0)
    one.close()
    (folder,) = recordings()
    found = numbers(folder)
    assert found[:100] == list(range(100))
    (about,) = said(folder, "/edgetree/recording")
    assert about["frames"] == len(found)
    assert about["frames"] + about["left_out"] == 300
    assert "too slow" in caplog.text


def test_a_recording_waits_for_the_disk(record, recordings, result, caplog, monkeypatch) -> None:
    monkeypatch.setattr(recorder, "_LONGEST_S", 10.0)
    one = record(everything=True, before_s=0.0, max_mib=1, waits=True)
    feed(one, result, 0, 300)
    one.close()
    assert [folder.name[:4] for folder in recordings()] == ["all_"] * 3
    found = [numbers(folder) for folder in recordings()]
    assert found == [list(range(100)), list(range(100, 200)), list(range(200, 300))]
    assert one.status.left_out == 0
    assert warned(caplog) == []


def test_what_is_not_written_in_time_is_left_out_and_the_rest_is_whole(
    record, recordings, result, monkeypatch
) -> None:
    original = RecordingFile.add

    def add_slowly(self: RecordingFile, result) -> None:
        original(self, result)
        time.sleep(0.3)

    monkeypatch.setattr(RecordingFile, "add", add_slowly)
    one = record()
    feed(one, result, 0, 20)  # would take 6 s
    one.mark()
    start_s = time.monotonic()
    one.close()
    assert 1.0 <= time.monotonic() - start_s < 4.0
    written = numbers(recordings()[0])
    assert written == list(range(len(written)))
    assert 1 <= len(written) <= 5
    assert one.status.left_out == 20 - len(written)


def test_a_clock_that_jumps_back_keeps_the_length_of_a_recording(
    record, recordings, result
) -> None:
    one = record(after_s=1.0, waits=True)
    feed(one, result, 1000, 1010)
    one.mark()
    feed(one, result, 0, 40)  # the camera was started again
    one.close()
    assert len(numbers(recordings()[0])) == 10 + 11


def test_a_full_disk_is_said_in_one_line_and_leaves_nothing(
    record, recordings, result, caplog, tmp_path, monkeypatch
) -> None:
    one = record(waits=True)
    one.write(result(0))
    big = np.random.default_rng(0).integers(0, 256, (2000, 2000, 3), np.uint8)
    with largest_file(4_000_000):
        one.write(result(1, image=big))
        one.mark()
        wait_until(lambda: one.status.failed == 1)
    (line,) = warned(caplog)
    assert line.startswith("a recording failed: ")
    assert str(tmp_path / "recordings" / "mark_") in line
    assert "(File too large)" in line
    assert list((tmp_path / "recordings").iterdir()) == []
    one.mark()  # with space again
    one.close()
    assert numbers(recordings()[0]) == [0, 1]


def test_a_gibibyte_of_the_disk_is_left_to_others(
    record, recordings, result, caplog, monkeypatch
) -> None:
    usage, asked = shutil.disk_usage("/"), itertools.count(1)

    def filling(_: object) -> object:
        return usage._replace(free=2**30 if next(asked) <= 5 else 2**30 - 1)

    monkeypatch.setattr(shutil, "disk_usage", filling)
    one = record(everything=True, waits=True)
    feed(one, result, 0, 10)
    one.close()
    assert numbers(recordings()[0]) == list(range(5))
    (line,) = warned(caplog)
    assert "less than 1 GiB of free space" in line


def test_a_folder_that_cannot_be_made_is_said_and_the_rest_goes_on(
    record, result, caplog, tmp_path
) -> None:
    one = record(waits=True)
    (tmp_path / "recordings").write_text("a file")
    one.write(result(0))
    one.mark()
    wait_until(lambda: one.status.failed == 1)
    one.write(result(1))
    one.close()
    (line,) = warned(caplog)
    assert "recordings" in line
    assert (tmp_path / "recordings").read_text() == "a file"


def test_a_camera_that_falls_silent_does_not_keep_a_recording_open(
    record, recordings, result, monkeypatch
) -> None:
    monkeypatch.setattr("edgetree.live.recording.queue._SILENCE_S", 0.0)
    one = record(after_s=0.1)
    one.write(result(0))
    one.mark()
    wait_until(recordings)
    assert numbers(recordings()[0]) == [0]


def test_a_recording_in_progress_can_be_read_so_far(record, result, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("edgetree.sinks.bag._CHUNK_S", 0.0)
    one = record(everything=True, waits=True)
    feed(one, result, 0, 5)  # far less than a chunk of the file

    def so_far() -> list[int]:
        (folder,) = (tmp_path / "recordings").glob("unfinished_all_*")
        with suppress(InputError):
            return numbers(folder)
        return []

    wait_until((tmp_path / "recordings").exists)
    wait_until(lambda: list((tmp_path / "recordings").glob("*")))
    wait_until(lambda: so_far() == [0, 1, 2, 3, 4])


def test_recordings_of_one_second_by_two_processes_have_names_of_their_own(
    record, recordings, result, monkeypatch
) -> None:
    monkeypatch.setattr(time, "strftime", lambda *_: "20261127_101530")
    both = [record(after_s=60.0, waits=True) for _ in range(2)]
    for number, one in enumerate(both):
        one.write(result(number))
        one.mark()
        wait_until(lambda one=one: one.status.is_recording)
    for one in both:
        one.close()
    assert [folder.name for folder in recordings()] == [f"mark_20261127_101530_{n}" for n in (1, 2)]
    assert sorted(numbers(folder) for folder in recordings()) == [[0], [1]]


def test_wrong_values_are_refused(tmp_path) -> None:
    (tmp_path / "file").write_text("")
    for settings, message in (
        ({"before_s": -1.0}, "before_s is -1 s: expected 0 to 60 s"),
        ({"max_mib": 0}, "max_mib is 0: expected at least 1 MiB"),
    ):
        with pytest.raises(InputError, match=message):
            FrameRecorder(tmp_path, **settings)
    with pytest.raises(InputError, match="file is a file: expected a folder"):
        FrameRecorder(tmp_path / "file")


def test_the_run_is_told_with_the_models_hash() -> None:
    told = run_record(default_model("depth"), source="oak", score_threshold=0.5, rig=Rig())
    assert json.loads(json.dumps(told))["source"] == "oak"
    assert len(told["model"]["sha256"]) == 64
    assert told["measure"]["max_diameter_m"] == 2.5


def write_interrupted(one: FrameRecorder, result, line: int | None) -> int:
    """Write a result; a signal handler marks before a line of it. Returns the number of lines."""
    lines = 0

    def trace(frame, event: str, _: object) -> object:
        nonlocal lines
        if event == "line" and Path(frame.f_code.co_filename).parent.name == "recording":
            lines += 1
            if lines == line:
                sys.settrace(None)
                one.mark(f"before line {line}")
        return trace

    sys.settrace(trace)
    try:
        one.write(result)
    finally:
        sys.settrace(None)
    return lines


def test_a_mark_by_a_signal_within_write_breaks_nothing(record, recordings, result, said) -> None:
    """The second frame comes 20 s later, so that the first one is forgotten meanwhile."""
    one = record()
    one.write(result(0))
    known: set[Path] = set()
    for line in range(1, 1 + write_interrupted(one, result(200), None)):
        one = record(waits=True)
        one.write(result(0))
        write_interrupted(one, result(200), line)
        one.close()
        assert one.status.line() == "1 recording"
        (folder,) = set(recordings()) - known
        known.add(folder)
        assert set(numbers(folder)) <= {0, 200}
        (mark,) = said(folder, "/edgetree/recording")[0]["marks"]
        assert mark["text"] == f"before line {line}"
    assert len(known) > 20


def test_a_mark_before_the_first_frame_takes_nothing_from_a_full_recording(result) -> None:
    queue = FrameQueue(5.0, 2.0, everything=True, max_mib=64, waits=False)
    queue.mark("early")
    for number in range(100):
        queue.put(result(number))
    queue.end(PATIENCE_S)
    written = []
    while (window := queue.next_window()) is not None:
        while (kept := queue.next_frame(window)) is not None:
            written.append(kept.result.frame.number)
    assert written == list(range(100))
