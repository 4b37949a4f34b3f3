"""Board calibration: accuracy, standard deviations, outliers and failures."""

import json
from collections.abc import Callable
from dataclasses import replace

import fake_boards as fake
import numpy as np
import pytest

from calib import CameraError
from calib.boards import (
    BoardDetections,
    BoardView,
    Calibration,
    CalibrationFailure,
    calibrate_camera,
)

SIZE = (640, 480)


def errors_in_stds(result: Calibration | CalibrationFailure, truth: object) -> list[float]:
    """Errors of fx, fy, cx, cy in units of their standard deviations."""
    assert isinstance(result, Calibration)
    return [(p.value - getattr(truth, p.name)) / p.std for p in result.parameters[:4]]


@pytest.mark.parametrize(
    ("board", "model", "within_px"),
    [
        ("checkerboard", "radtan", 1.0),
        ("checkerboard", "fisheye", 0.3),
        ("charuco", "radtan", 1.0),
        ("asymmetric", "radtan", 2.0),
    ],
)
def test_the_camera_is_recovered_from_images(
    seen: Callable[[str, str], BoardDetections],
    board: str,
    model: str,
    within_px: float,
) -> None:
    truth = fake.TRUTH[model]
    views = seen(board, model).views
    result = calibrate_camera(views, SIZE, model)
    assert isinstance(result, Calibration)
    assert result.passed, result.reasons
    camera = result.camera
    assert (camera.width, camera.height, camera.distortion_model) == (*SIZE, model)
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(camera, name) - getattr(truth, name)) < within_px, name
    assert np.abs(errors_in_stds(result, truth)).max() < 4
    fx, fy = result.parameters[:2]
    assert camera.focal_std_px == max(fx.std, fy.std)
    assert 0 < camera.focal_std_px < 0.005 * camera.fx
    assert result.rms_px < 0.12
    assert {view.name for view in result.views} <= {view.name for view in views}


@pytest.mark.parametrize("model", ["radtan", "fisheye"])
def test_standard_deviations_match_the_errors(model: str) -> None:
    truth = fake.TRUTH[model]
    off = []
    for seed in range(12):
        # Few views: with many, their differences would also reveal the uncertainty.
        views = fake.seen_points(truth, fake.poses(truth, 12, seed), seed)[:9]
        result = calibrate_camera(views, SIZE, model)
        off.append(errors_in_stds(result, truth))
    # Of 48 errors in standard deviations, the mean square is about 1.
    assert 0.4 < np.mean(np.square(off)) < 1.2


def test_each_view_gives_its_boards_pose() -> None:
    poses = fake.poses(fake.RADTAN, 16, seed=2)
    views = fake.seen_points(fake.RADTAN, poses, 0)
    result = calibrate_camera(views, SIZE)
    assert isinstance(result, Calibration)
    for view in result.views:
        pose = poses[int(view.name.removeprefix("view"))]
        np.testing.assert_allclose(view.pose[3:], pose.translation_m, atol=0.004)
        middle_m = pose.rotation @ [0.1, 0.0625, 0] + pose.translation_m
        assert view.distance_m == pytest.approx(middle_m[2], abs=0.004)
        tilt_deg = np.degrees(np.arccos(pose.rotation[2, 2]))
        assert view.tilt_deg == pytest.approx(tilt_deg, abs=1)
        assert view.points == 54
        assert 0.08 < view.rms_px < 0.2 < view.worst_px < 0.7


@pytest.mark.parametrize("wrong_views", [1, 4])
def test_wrong_views_and_points_are_dropped_and_named(wrong_views: int) -> None:
    truth = fake.RADTAN
    views = fake.seen_points(truth, fake.poses(truth, 20, seed=3), 1)
    whole = calibrate_camera(views, SIZE)
    assert isinstance(whole, Calibration)
    assert whole.dropped == ()
    for i in range(wrong_views):
        rows = views[i].image_px.reshape(6, 9, 2)[[1, 0, 2, 3, 5, 4]]
        views[i] = replace(views[i], image_px=rows.reshape(-1, 2))
    mistaken_px = views[-1].image_px.copy()
    mistaken_px[[4, 20]] += (6, -3)
    views[-1] = replace(views[-1], image_px=mistaken_px)

    result = calibrate_camera(views, SIZE)

    assert np.abs(errors_in_stds(result, truth)).max() < 3.5
    named = {(dropped.view, dropped.points) for dropped in result.dropped}
    assert named == {(view.name, ()) for view in views[:wrong_views]} | {(views[-1].name, (4, 20))}
    for dropped in result.dropped:
        assert "residual" in dropped.reason or "off by more than" in dropped.reason


def test_a_blurred_view_is_dropped() -> None:
    poses = fake.poses(fake.RADTAN, 20, seed=3)
    views = fake.seen_points(fake.RADTAN, poses, 1)
    rng = np.random.default_rng(2)
    uneasy_px = views[5].image_px + rng.normal(0, 0.4, views[5].image_px.shape)
    result = calibrate_camera([*views[:5], replace(views[5], image_px=uneasy_px), *views[6:]], SIZE)
    assert isinstance(result, Calibration)
    (dropped,) = result.dropped
    assert (dropped.view, dropped.points) == (views[5].name, ())
    assert dropped.reason.startswith("its median residual is 0.4 px")


def test_too_few_views_are_rejected() -> None:
    views = fake.seen_points(fake.RADTAN, fake.poses(fake.RADTAN, 20, seed=3), 1)
    failure = calibrate_camera(views[:7], SIZE)
    assert not failure
    assert isinstance(failure, CalibrationFailure)
    assert failure.reason == "7 views of the board, expected at least 8"
    none = calibrate_camera([], SIZE)
    assert isinstance(none, CalibrationFailure)
    assert none.reason == "0 views of the board, expected at least 8"


def test_contradictory_views_are_rejected() -> None:
    views = fake.seen_points(fake.RADTAN, fake.poses(fake.RADTAN, 20, seed=3), 1)[:9]
    rng = np.random.default_rng(0)
    for i in range(3):
        views[i] = replace(views[i], image_px=rng.permutation(views[i].image_px))
    failure = calibrate_camera(views, SIZE)
    assert isinstance(failure, CalibrationFailure)
    assert "views of the board that agree with each other, expected at least 8" in failure.reason
    assert {dropped.view for dropped in failure.dropped} >= {view.name for view in views[:3]}


@pytest.mark.parametrize("model", ["radtan", "fisheye"])
def test_a_single_board_orientation_is_rejected(model: str) -> None:
    frontal = fake.poses(fake.RADTAN, 20, seed=3, tilt_deg=5)
    failure = calibrate_camera(fake.seen_points(fake.RADTAN, frontal, 1), SIZE, model)
    assert isinstance(failure, CalibrationFailure)
    assert "nearly the same orientation in all views" in failure.reason
    assert failure.advice == ("tilt the board by 20 to 45 degrees in all directions",)


def test_points_only_in_the_middle_are_rejected() -> None:
    poses = fake.poses(fake.RADTAN, 20, seed=3, spread=0.02)
    far = [pose._replace(translation_m=pose.translation_m * 2) for pose in poses]
    failure = calibrate_camera(fake.seen_points(fake.RADTAN, far, 1), SIZE)
    assert isinstance(failure, CalibrationFailure)
    assert "% of the image, expected at least 25%" in failure.reason
    assert "the bottom right corner has no points: hold the board there" in failure.advice
    assert not any("middle" in line for line in failure.advice)


def test_a_corner_without_points_is_named() -> None:
    views = fake.seen_points(fake.RADTAN, fake.poses(fake.RADTAN, 24, seed=3), 1)
    elsewhere = [
        v for v in views if not ((v.image_px[:, 0] < 215) & (v.image_px[:, 1] < 165)).any()
    ]
    result = calibrate_camera(elsewhere, SIZE)
    assert isinstance(result, Calibration)
    assert "the top left corner has no points: hold the board there" in result.advice
    assert not any("right edge" in line for line in result.advice)
    digits = result.coverage.text()
    assert (len(digits), {len(row) for row in digits}) == (9, {12})
    assert {row[:4] for row in digits[:3]} == {"...."}
    assert digits[4][6] != "."


def test_poor_calibrations_do_not_pass() -> None:
    poses = fake.poses(fake.RADTAN, 14, seed=3)
    coarse = calibrate_camera(fake.seen_points(fake.RADTAN, poses, 1, noise_px=1.0), SIZE)
    assert isinstance(coarse, Calibration)
    assert not coarse.passed
    rms, focal = coarse.reasons
    assert rms.endswith(" px, expected 0.8 or less")
    assert focal.startswith("the focal length has a standard deviation of")
    many = fake.seen_points(fake.RADTAN, fake.poses(fake.RADTAN, 40, seed=3), 1)
    left = calibrate_camera([view for view in many if view.image_px[:, 0].max() < 370], SIZE)
    assert isinstance(left, Calibration)
    assert any(reason.endswith("of the image, expected at least 50%") for reason in left.reasons)


def test_a_lens_that_refocuses_does_not_pass() -> None:
    views = fake.seen_points(fake.RADTAN, fake.poses(fake.RADTAN, 20, seed=3), 1)
    centre_px = (fake.RADTAN.cx, fake.RADTAN.cy)
    for i, view in enumerate(views):
        grown_px = centre_px + (view.image_px - centre_px) * (1.05 if i % 2 else 0.95)
        views[i] = replace(view, image_px=grown_px)
    result = calibrate_camera(views, SIZE)
    assert isinstance(result, Calibration)
    # Each board's distance hides the change: the residuals are small, but not by chance.
    assert result.rms_px < 0.5
    assert not result.passed
    assert abs(errors_in_stds(result, fake.RADTAN)[0]) < 4


def test_results_are_plain_json_values() -> None:
    views = fake.seen_points(fake.RADTAN, fake.poses(fake.RADTAN, 16, seed=2), 0)
    for result in (calibrate_camera(views, SIZE), calibrate_camera(views[:3], SIZE)):
        values = json.loads(json.dumps(result.to_dict(), allow_nan=False))
        assert values["passed"] is bool(result)
    assert values["reasons"] == ["3 views of the board, expected at least 8"]


def test_an_unknown_lens_model_is_rejected() -> None:
    with pytest.raises(CameraError, match="model is 'pinhole': expected one of radtan, fisheye"):
        calibrate_camera([BoardView("a", np.zeros((9, 2)), np.zeros((9, 3)))], SIZE, "pinhole")
