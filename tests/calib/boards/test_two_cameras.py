"""Views of two cameras that were calibrated as one."""

from __future__ import annotations

from dataclasses import replace

import fake_boards as fake
import numpy as np
import pytest

from calib import PinholeCamera
from calib.boards import BoardView, Calibration, CalibrationFailure, calibrate_camera

SIZE = (640, 480)
ONE = fake.RADTAN
OTHER = replace(ONE, fx=536.0, fy=539.0, cx=318.0, cy=241.0)


def views_of(camera: PinholeCamera, seed: int, names: str, count: int = 13) -> list[BoardView]:
    """Views with names such as left-{:03}."""
    found = fake.seen_points(camera, fake.poses(camera, count + 4, seed), seed)[:count]
    return [replace(view, name=names.format(i)) for i, view in enumerate(found)]


def calibrated(views: list[BoardView]) -> Calibration:
    result = calibrate_camera(views, SIZE)
    assert isinstance(result, Calibration)
    return result


@pytest.mark.parametrize(
    ("one", "other", "told"),
    [
        ("left-{:03}", "right-{:03}", "with 'left' and with 'right' in their names"),
        ("cam0_{:03}", "cam1_{:03}", "with 'cam0' and with 'cam1' in their names"),
        ("L{}", "R{}", "with 'l' and with 'r' in their names"),
        ("2024_monday_{}", "2024_friday_{}", "with 'friday' and with 'monday' in their names"),
        ("{:04}", "1{:03}", "up to 0011 and from 1000 on"),
    ],
)
def test_two_cameras_are_told_by_name_or_by_order(one: str, other: str, told: str) -> None:
    views = views_of(ONE, 3, one) + views_of(OTHER, 8, other)
    result = calibrated(views)
    assert not result.passed
    assert told in result.reasons[0]
    assert "do not fit one camera (focal lengths of 5" in result.reasons[0]


def test_the_focal_lengths_are_those_of_each_camera() -> None:
    views = views_of(ONE, 3, "left{}") + views_of(OTHER, 8, "right{}")
    words = calibrated(views).reasons[0].split("focal lengths of ")[1].split(" px")[0]
    one, other = (float(word) for word in words.split(" and "))
    assert one == pytest.approx(ONE.fy, abs=2)
    assert other == pytest.approx(OTHER.fy, abs=2)


def test_pictures_taken_in_turn_are_told() -> None:
    both = zip(views_of(ONE, 3, "a{}"), views_of(OTHER, 8, "a{}"), strict=False)
    views = [view for pair in both for view in pair]
    views = [replace(view, name=f"{i:05}") for i, view in enumerate(views)]
    assert "at odd and at even places" in calibrated(views).reasons[0]


@pytest.mark.parametrize(
    ("one", "other", "is_told"),
    [("left-{}", "right-{}", True), ("near-{}", "far-{}", False), ("{:03}", "1{:02}", False)],
)
def test_one_camera_passes_whatever_the_names(one: str, other: str, is_told: bool) -> None:
    result = calibrated(views_of(ONE, 3, one) + views_of(ONE, 8, other))
    assert result.passed, result.reasons
    assert ("are taken for one camera, which they fit" in " ".join(result.advice)) == is_told


def test_a_bent_board_is_not_two_cameras() -> None:
    """Errors that all points of a view share are no sign of another camera."""
    flagged = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        views = []
        for i, view in enumerate(views_of(ONE, seed + 20, "{}", 17)):
            bend = 0.4 * (view.object_m[:, :1] / 0.2) ** 2 + rng.normal(0, 0.2, (1, 2)) * (
                view.object_m[:, 1:2] / 0.1
            )
            views.append(replace(view, image_px=view.image_px + bend, name=f"{'ab'[i % 2]}_{i:02}"))
        flagged += any("one camera" in reason for reason in calibrated(views).reasons)
    assert flagged == 0


def test_pictures_of_another_camera_that_are_all_left_out_are_told() -> None:
    far = replace(ONE, fx=640.0, fy=800.0)
    views = views_of(ONE, 3, "left-{}", 16) + views_of(far, 8, "right-{}", 6)
    result = calibrate_camera(views, SIZE)
    left_out = {each.view for each in result.dropped if not each.points}
    assert {name.split("-")[0] for name in left_out} == {"right"}
    assert "all pictures with 'right' in their names are left out" in " ".join(result.advice)


def test_a_limit_that_is_just_missed_has_enough_digits() -> None:
    views = [
        replace(view, image_px=view.image_px + np.random.default_rng(i).normal(0, 0.55, (54, 2)))
        for i, view in enumerate(views_of(ONE, 3, "{}", 9))
    ]
    result = calibrate_camera(views, SIZE)
    assert not isinstance(result, CalibrationFailure)
    share = result.camera.focal_std_px / result.camera.fx
    assert share > 0.005
    text = " ".join(result.reasons)
    assert f"a standard deviation of {share:.2%}, expected 0.50% or less" in text
