"""A whole drive: the report, its lines, and sources that cannot be checked."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from rig_drives import GivenSource, panning_drive, warp_depth, without

from basetree.errors import InputError
from edgetree import TreeDetector
from edgetree.catalogue import default_model
from edgetree.frames.frame import Frame
from edgetree.rig_check import check_rig, report_lines


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


class EndlessSource(GivenSource):
    """Frames again and again, with rising times; it fails if it is read for far too long.

    Args:
        frames: what is repeated.
        step_s: time from frame to frame, s.
    """

    def __init__(self, frames: list[Frame], step_s: float) -> None:
        super().__init__(frames)
        self._step_s = step_s

    def __iter__(self) -> Iterator[Frame]:
        for number in range(1000):
            frame = self._frames[number % len(self._frames)]
            yield replace(frame, number=number, time_s=1000 + number * self._step_s)
        pytest.fail("the source was read beyond the limit")


def test_a_camera_without_depth_ends_and_is_refused(detector: TreeDetector) -> None:
    source = EndlessSource(without(panning_drive(1), "depth_m"), 0.1)
    with pytest.raises(InputError, match="has no depth"):
        check_rig(source, detector, seconds=5)
    assert source.is_closed


def test_pictures_that_never_pair_end_and_are_refused(detector: TreeDetector) -> None:
    frames = panning_drive(1)
    alone = [without(frames, "depth_m")[0], without(frames, "image")[1]]
    with pytest.raises(InputError, match="has 0 frames with colour and depth"):
        check_rig(EndlessSource(alone, 0.1), detector, seconds=5)


def test_a_camera_whose_stamps_stand_still_ends(
    detector: TreeDetector, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = EndlessSource(without(panning_drive(1), "depth_m"), 0.0)
    source.is_live = True
    clock = iter(range(2000))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(clock)))
    with pytest.raises(InputError, match="has no depth"):
        check_rig(source, detector, seconds=30)


def test_frames_of_different_sizes_are_refused(detector: TreeDetector) -> None:
    frames = panning_drive(2)
    for number in range(10, 20):
        image, depth_m, camera = frames[number].image, frames[number].depth_m, frames[number].camera
        assert image is not None
        assert depth_m is not None
        assert camera is not None
        frames[number] = replace(
            frames[number],
            image=np.ascontiguousarray(image[::2, ::2]),
            depth_m=np.ascontiguousarray(depth_m[::2, ::2]),
            camera=camera.scaled(320, 180),
        )
    message = "given: frame 10 is 320x180 px and frame 5 640x360 px: expected frames of one size"
    with pytest.raises(InputError, match=message):
        check_rig(GivenSource(frames), detector)


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
    detector: TreeDetector, change: Callable[[list[Frame]], list[Frame]], message: str
) -> None:
    source = GivenSource(change(panning_drive(1)))
    with pytest.raises(InputError, match=message):
        check_rig(source, detector)
    assert source.is_closed


def test_depth_without_readings_is_a_fault_of_the_stream(detector: TreeDetector) -> None:
    report = check_rig(GivenSource(panning_drive(3, change=np.zeros_like)), detector)
    assert [check.name for check in report.problems] == ["faulty depth", "depth that repeats"]
