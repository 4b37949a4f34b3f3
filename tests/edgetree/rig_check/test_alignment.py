"""Faults between depth and colour are found with their size, and good depth holds."""

from __future__ import annotations

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from rig_drives import Float32, panning_drive, warp_depth

from edgetree.frames.frame import Frame
from edgetree.rig_check.alignment import FrameSilhouettes, alignment_checks
from edgetree.rig_check.checks import RigCheck
from edgetree.rig_check.image_motion import image_velocity
from edgetree.rig_check.peak_fit import Profiles, fit_peak
from edgetree.rig_check.silhouettes import find_silhouettes


def checks_of(frames: list[Frame], every: int = 5) -> dict[str, RigCheck]:
    found = []
    for before, frame in list(pairwise(frames))[::every]:
        assert frame.image is not None
        assert before.image is not None
        assert frame.depth_m is not None
        seen = find_silhouettes(frame.image, frame.depth_m)
        step_s = frame.time_s - before.time_s
        velocity = image_velocity(before.image, frame.image, step_s, seen.xy_px)
        found.append(FrameSilhouettes(frame.time_s, seen, velocity))
    camera = frames[0].camera
    assert camera is not None
    return {check.name: check for check in alignment_checks(found, camera)}


def test_good_depth_holds() -> None:
    checks = checks_of(panning_drive())
    assert {check.verdict for check in checks.values()} == {"holds"}


@pytest.mark.parametrize(
    ("name", "expected", "tolerance", "change"),
    [
        ("shift to the right", 8.0, 0.6, partial(warp_depth, x=8)),
        ("shift to the right", -6.0, 0.6, partial(warp_depth, x=-6)),
        ("size", 2.0, 0.3, partial(warp_depth, size=1.02)),
        ("turn clockwise", 1.5, 0.25, partial(warp_depth, turn_deg=1.5)),
    ],
)
def test_moved_depth_does_not_hold(
    name: str, expected: float, tolerance: float, change: partial[Float32]
) -> None:
    check = checks_of(panning_drive(change=change))[name]
    assert check.verdict == "does not hold"
    assert check.value == pytest.approx(expected, abs=tolerance)
    assert check.half_interval is not None
    assert check.half_interval < 1


def test_late_depth_is_told_from_shifted_depth() -> None:
    checks = checks_of(panning_drive(late=1))
    assert checks["delay of the depth"].verdict == "does not hold"
    assert checks["delay of the depth"].value == pytest.approx(100, abs=25)
    assert checks["shift to the right"].verdict == "holds"


def test_a_picture_without_edges_cannot_tell() -> None:
    generator = np.random.default_rng(0)
    frames = panning_drive()
    for frame in frames:
        assert frame.image is not None
        frame.image[:] = generator.integers(20, 24, frame.image.shape)
    checks = checks_of(frames)
    assert {check.verdict for check in checks.values()} == {"cannot tell"}
    assert "no edges where depth jumps" in checks["size"].reason


@pytest.mark.parametrize("level", [0, 128])
def test_a_picture_of_one_colour_cannot_tell(level: int) -> None:
    frames = panning_drive()
    for frame in frames:
        assert frame.image is not None
        frame.image[:] = level
    checks = checks_of(frames)
    assert {check.verdict for check in checks.values()} == {"cannot tell"}
    assert "the picture is too dark" in checks["size"].reason


@pytest.mark.parametrize("height", [0.0, 1e-5])
def test_a_peak_of_rounding_errors_has_no_contrast(height: float) -> None:
    gradient = np.zeros((100, 49), np.float32)
    gradient[:, 24] = height
    profiles = Profiles(gradient, np.ones((100, 1)), np.arange(100) // 10)
    assert fit_peak(profiles, np.zeros(1)).contrast == 0


def test_a_short_drive_cannot_tell() -> None:
    checks = checks_of(panning_drive(4.0), every=1)
    assert {check.verdict for check in checks.values()} == {"cannot tell"}
    assert "10 s" in checks["size"].reason


def test_depth_without_jumps_cannot_tell() -> None:
    checks = checks_of(panning_drive(change=lambda depth_m: np.full_like(depth_m, 5)))
    assert "0 silhouettes" in checks["size"].reason
