"""A whole drive: the report, its lines, and sources that cannot be checked."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from rig_drives import GivenSource, panning_drive, warp_depth, without

from edgetree import TreeDetector
from edgetree.errors import InputError
from edgetree.live.frames import LiveFrame
from edgetree.rig_check import check_rig, report_lines
from edgetree.runtime.detector import default_model


@pytest.fixture(scope="module")
def detector() -> TreeDetector:
    return TreeDetector.load(default_model("depth"), threads=2)


def test_a_shifted_depth_fails_with_words_and_advice(detector: TreeDetector) -> None:
    source = GivenSource(panning_drive(change=partial(warp_depth, x=8)))
    report = check_rig(source, detector)
    assert source.is_closed
    assert not report.passed
    assert [check.name for check in report.problems] == ["shift to the right"]
    text = "\n".join(report_lines(report))
    assert "result: failed: shift to the right is +8" in text
    assert "calibrate the two cameras" in text
    record = report.to_dict()
    assert record["passed"] is False
    assert record["checks"][0]["verdict"] == "does not hold"


def test_good_depth_passes_and_says_what_cannot_be_told(detector: TreeDetector) -> None:
    report = check_rig(GivenSource(panning_drive()), detector)
    assert report.passed
    assert report.stems > 0
    text = "\n".join(report_lines(report))
    assert "needs the poses of the camera" in text
    assert "result: passed, but" in text


def test_only_the_wanted_seconds_are_read(detector: TreeDetector) -> None:
    report = check_rig(GivenSource(panning_drive(6)), detector, seconds=2)
    assert report.seconds == pytest.approx(2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda frames: without(frames, "image"), "has no colour"),
        (lambda frames: without(frames, "depth_m"), "has no depth"),
        (lambda frames: frames[:1], "expected at least two"),
        (lambda frames: without(frames, "camera"), "pass --camera"),
    ],
)
def test_a_source_that_lacks_something_is_refused(
    detector: TreeDetector, change: Callable[[list[LiveFrame]], list[LiveFrame]], message: str
) -> None:
    source = GivenSource(change(panning_drive(1)))
    with pytest.raises(InputError, match=message):
        check_rig(source, detector)
    assert source.is_closed


def test_depth_without_readings_is_a_fault_of_the_stream(detector: TreeDetector) -> None:
    report = check_rig(GivenSource(panning_drive(3, change=np.zeros_like)), detector)
    assert [check.name for check in report.problems] == ["faulty depth", "depth that repeats"]
