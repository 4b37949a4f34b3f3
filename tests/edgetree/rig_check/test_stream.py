"""Frames that repeat, have faults, or come at wrong times are counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rig_drives import panning_drive

from edgetree.frames.frame import Frame
from edgetree.rig_check.checks import RigCheck
from edgetree.rig_check.stream import StreamCounts
from edgetree.sources.source import DEPTH_PLACED_BY_GUESS, REMARKS


def checks_of(frames: list[Frame], **source_counts: int) -> dict[str, RigCheck]:
    counts = StreamCounts()
    for frame in frames:
        counts.add(frame)
    return {check.name: check for check in counts.checks(source_counts)}


def failing(checks: dict[str, RigCheck]) -> set[str]:
    return {check.name for check in checks.values() if check.verdict == "does not hold"}


def test_good_frames_hold() -> None:
    checks = checks_of(panning_drive(4))
    assert {check.verdict for check in checks.values()} == {"holds"}


def test_a_hanging_depth_camera_is_found() -> None:
    frames = panning_drive(4)
    stuck = [replace(frame, depth_m=frames[10].depth_m) for frame in frames[11:15]]
    checks = checks_of(frames[:11] + stuck + frames[15:])
    assert failing(checks) == {"depth that repeats"}
    assert checks["depth that repeats"].value == 100 * 4 / 39


def test_a_camera_that_stands_does_not_hang() -> None:
    frames = panning_drive(4)
    still = [replace(frame, image=frames[0].image, depth_m=frames[0].depth_m) for frame in frames]
    assert failing(checks_of(still)) == set()


def test_a_hanging_colour_camera_is_found() -> None:
    frames = panning_drive(4)
    stuck = [replace(frame, image=frames[10].image) for frame in frames[11:15]]
    assert failing(checks_of(frames[:11] + stuck + frames[15:])) == {"colour that repeats"}


def test_wrong_times_and_gaps_are_found() -> None:
    frames = panning_drive(4)
    back = [replace(frame, time_s=0.0) if frame.number == 9 else frame for frame in frames]
    assert "time stamps that do not rise" in failing(checks_of(back))
    gaps = [replace(frame, time_s=frame.time_s + frame.number // 5) for frame in frames]
    assert failing(checks_of(gaps)) == {"gaps in time"}


def test_faulty_depth_is_found_and_named() -> None:
    frames = panning_drive(4)
    for frame in frames[4::8]:
        assert frame.depth_m is not None
        frame.depth_m[:] = np.float32(3)
    checks = checks_of(frames)
    assert failing(checks) == {"faulty depth"}
    assert "frame 4: every reading is 3 m" in checks["faulty depth"].reason


def test_what_the_source_left_out_counts() -> None:
    checks = checks_of(panning_drive(4), **{"colour without depth": 9})
    assert failing(checks) == {"frames left out"}
    assert "9 colour without depth" in checks["frames left out"].reason


@pytest.mark.parametrize("remark", sorted(REMARKS - {DEPTH_PLACED_BY_GUESS}))
def test_remarks_on_frames_that_were_used_do_not_count(remark: str) -> None:
    checks = checks_of(panning_drive(4), **{remark: 40})
    assert failing(checks) == set()
    assert checks["frames left out"].value == 0


def test_depth_from_an_unknown_place_is_a_fault_of_few_frames_too() -> None:
    checks = checks_of(panning_drive(1), **{DEPTH_PLACED_BY_GUESS: 1})
    assert failing(checks) == {"depth from an unknown place"}
    assert "other lenses" in checks["depth from an unknown place"].reason


@pytest.mark.parametrize(
    "what",
    [
        "colour with a repeated or late stamp",
        "depth with a repeated or late stamp",
        "clock jumped back",
    ],
)
def test_wrong_stamps_that_the_source_counts_are_wrong_times(what: str) -> None:
    checks = checks_of(panning_drive(4), **{what: 13})
    assert failing(checks) == {"time stamps that do not rise"}
    stamps = checks["time stamps that do not rise"]
    assert stamps.value == 100 * 13 / (39 + 13)
    assert stamps.reason == f"the clock is wrong: 13 {what}"


def test_few_frames_cannot_tell() -> None:
    checks = checks_of(panning_drive(1))
    assert checks["faulty depth"].verdict == "cannot tell"
