"""Fit of a depth camera's scale and offset, with standard deviations."""

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputFileError
from calib import (
    CameraError,
    DepthError,
    DepthScale,
    DepthScaleFailure,
    PinholeCamera,
    TargetReadings,
    fit_depth_scale,
    load_depth_scale,
    read_target,
    save_depth_scale,
)
from calib.scale_limits import tell_scale

Float = NDArray[np.floating[Any]]

SCALE, OFFSET_M = 1.015, 0.02
DISTANCES_M = (0.5, 0.8, 1.2, 1.6, 2.0, 2.5, 3.0, 4.0)


def targets(
    seed: int = 0, distances_m: tuple[float, ...] = DISTANCES_M, place_share: float = 0.003
) -> list[TargetReadings]:
    """Tilted targets with noise that grows with z squared and small placement errors."""
    rng = np.random.default_rng(seed)
    found = []
    for i, distance_m in enumerate(distances_m):
        true_m = distance_m * rng.uniform(0.9, 1.1, 300)
        misplaced_m = distance_m * rng.normal(0, place_share)
        noise_m = rng.normal(0, 0.002 * distance_m**2, 300)
        measured_m = (true_m + misplaced_m - OFFSET_M) / SCALE + noise_m
        found.append(TargetReadings(f"target{i}", true_m, measured_m))
    return found


def fitted(readings: list[TargetReadings]) -> DepthScale:
    result = fit_depth_scale(readings)
    assert isinstance(result, DepthScale)
    return result


def test_scale_and_offset_are_found() -> None:
    result = fitted(targets(place_share=1e-4))
    assert result.scale == pytest.approx(SCALE, abs=4e-4)
    assert result.offset_m == pytest.approx(OFFSET_M, abs=5e-4)
    assert result.dropped == ()
    assert result.nearest_m == pytest.approx(0.5, rel=0.02)
    assert result.farthest_m == pytest.approx(4.0, rel=0.02)
    for target, distance_m in zip(result.targets, DISTANCES_M, strict=True):
        assert target.noise_std_m == pytest.approx(0.002 * distance_m**2, rel=0.15)
        assert abs(target.residual_m) < 0.001 * distance_m
        assert target.pixels > 290


def test_standard_deviations_match_the_errors() -> None:
    results = [fitted(targets(seed)) for seed in range(60)]
    scale_off = [(r.scale - SCALE) / r.scale_std for r in results]
    offset_off = [(r.offset_m - OFFSET_M) / r.offset_std_m for r in results]
    at_2_m = [(2 * r.scale + r.offset_m - (2 * SCALE + OFFSET_M)) / r.std_m(2.0) for r in results]
    for off in (scale_off, offset_off, at_2_m):
        # With six degrees of freedom the mean square of Student's t is 1.5.
        assert 0.7 < np.mean(np.square(off)) < 2.6


def test_the_focal_lengths_uncertainty_is_included() -> None:
    share, rng = 0.02, np.random.default_rng(1)
    off: list[list[float]] = []
    for seed in range(60):
        stretch = 1 + rng.normal(0, share)
        readings = [
            TargetReadings(t.name, t.true_m * stretch, t.measured_m, share) for t in targets(seed)
        ]
        result = fitted(readings)
        at_2_m = 2 * result.scale + result.offset_m - (2 * SCALE + OFFSET_M)
        off.append([(result.scale - SCALE) / result.scale_std, at_2_m / float(result.std_m(2.0))])
    assert np.all(np.abs(np.mean(np.square(off), 0) - 1.1) < 0.5)


def test_outlying_pixels_and_targets_are_ignored() -> None:
    readings = targets()
    for each in readings:
        each.measured_m[:60] = 0
        each.measured_m[60:100] *= 1.6
        each.measured_m[100:110] = np.nan
    readings[3].measured_m[:] *= 1.05
    readings.append(TargetReadings("hidden", np.full(300, 1.0), np.zeros(300)))
    result = fitted(readings)
    assert result.dropped == ("target3", "hidden")
    assert abs(result.scale - SCALE) < 3.5 * result.scale_std
    assert result.scale_std < 0.004
    assert all(target.pixels <= 190 for target in result.targets)


@pytest.mark.parametrize(
    ("distances_m", "message"),
    [
        ((1.0, 2.0, 3.0), "3 targets with depth that agree with each other, expected at least 4"),
        ((1.0, 1.0, 1.0, 2.0, 2.0), "expected at least 3 distances, the farthest 1.5 times"),
        ((1.0, 1.1, 1.2, 1.3, 1.35), "to separate offset and scale"),
    ],
)
def test_too_few_distances_are_rejected(distances_m: tuple[float, ...], message: str) -> None:
    failure = fit_depth_scale(targets(distances_m=distances_m))
    assert not failure
    assert isinstance(failure, DepthScaleFailure)
    assert message in failure.reason


def test_readings_that_do_not_follow_the_distance_are_rejected() -> None:
    stuck = [TargetReadings(t.name, t.true_m, np.full(300, 4.0)) for t in targets()]
    failure = fit_depth_scale(stuck)
    assert isinstance(failure, DepthScaleFailure)
    assert failure.reason.startswith("the readings went from 4.00 to 4.00 m as the target went")
    backwards = [TargetReadings(t.name, t.true_m, 5 - t.true_m) for t in targets()]
    assert isinstance(fit_depth_scale(backwards), DepthScaleFailure)


def test_apply_keeps_missing_readings() -> None:
    result = DepthScale(1.1, -0.5, 0.01, 0.02, -0.5, 1.0, 3.0)
    readings = np.array([[0.0, 0.4, 2.0], [np.nan, np.inf, 1.0]], np.float32)
    true_m = result.apply(readings)
    assert true_m.dtype == np.float32
    np.testing.assert_allclose(true_m, [[0, 0, 1.7], [0, 0, 0.6]], atol=1e-6)
    variance = (2 * 0.01) ** 2 + 0.02**2 - 0.5 * 2 * 2 * 0.01 * 0.02
    assert float(result.std_m(2.0)) == pytest.approx(math.sqrt(variance))


@pytest.mark.parametrize("model", ["radtan", "fisheye"])
def test_true_depths_follow_from_the_boards_pose(model: str) -> None:
    camera = PinholeCamera(
        320, 240, 200.0, 201.0, 161.0, 118.0, (-0.1, 0.02, 0.001, -0.001), model, focal_std_px=2.0
    )
    pose = (0.5, -0.3, 0.1, 0.05, -0.02, 1.0)
    u, v = np.meshgrid(np.linspace(-0.2, 0.2, 9), np.linspace(-0.15, 0.15, 7))
    board_m = np.stack([u.ravel(), v.ravel(), 0 * u.ravel()], -1)
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    function = cv2.fisheye.projectPoints if model == "fisheye" else cv2.projectPoints
    xy = function(
        board_m[:, None],
        np.array(pose[:3]),
        np.array(pose[3:]),
        matrix,
        np.array(camera.distortion),
    )[0].reshape(-1, 2)
    z = (board_m @ cv2.Rodrigues(np.array(pose[:3]))[0].T + pose[3:])[:, 2]
    # A depth map with the true depth of each board point in the pixels around it.
    depth_m = np.zeros((240, 320), np.float32)
    columns, rows = np.rint(xy).astype(int).T
    depth_m[rows, columns] = z
    readings = read_target("board", camera, pose, xy + 0.5, depth_m)
    assert readings.focal_std_share == 0.01
    read = readings.measured_m > 0
    assert read.sum() >= 40
    assert len(readings.true_m) > 2000
    # A pixel's centre is up to half a pixel from the point.
    np.testing.assert_allclose(readings.true_m[read], readings.measured_m[read], atol=0.004)


def test_depth_of_another_size_is_rejected() -> None:
    camera = PinholeCamera(320, 240, 200.0, 200.0, 160.0, 120.0)
    square_px = [(10, 10), (50, 10), (50, 50), (10, 50)]
    with pytest.raises(CameraError, match=r"depth of a is 64x48 px: expected the camera's 320x240"):
        read_target("a", camera, (0, 0, 0, 0, 0, 1), square_px, np.ones((48, 64), np.float32))


def test_a_depth_scale_file_round_trips(tmp_path: Path) -> None:
    readings = targets()
    readings[2].measured_m[:] *= 1.1
    result = fitted(readings)
    assert result.dropped
    path = tmp_path / "depth_scale.json"
    save_depth_scale(path, result)
    assert load_depth_scale(path) == result
    assert json.loads(path.read_text())["schema"] == "calib.depth_scale/1"
    assert list(tmp_path.iterdir()) == [path]


TARGET = {"name": "a", "distance_m": 1.0, "residual_m": 0.0, "noise_std_m": 0.0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": "other/1"}, "schema is 'other/1', expected 'calib.depth_scale/1'"),
        ({"scale": 0}, "scale is 0.0: expected 0.0001 to 10000"),
        ({"scale": "1"}, "scale is '1': expected a finite number"),
        ({"offset_m": None}, "offset_m is None: expected a finite number"),
        ({"scale_std": -1.0}, "scale_std is -1.0: expected"),
        ({"correlation": 1.5}, "correlation is 1.5: expected -1 to 1"),
        ({"targets": 3}, "targets is 3: expected a list of objects"),
        ({"dropped": [1]}, "dropped is [1]: expected a list of names"),
        ({"targets": [{"name": "a"}]}, "distance_m is None: expected a finite number"),
        ({"targets": [{**TARGET, "pixels": math.nan}]}, "pixels is nan: expected a finite number"),
        ({"targets": [{**TARGET, "pixels": 10**400}]}, "expected a finite number"),
    ],
)
def test_bad_files_are_named(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = tmp_path / "depth_scale.json"
    values = {"schema": "calib.depth_scale/1", **fitted(targets()).to_dict(), **change}
    path.write_text(json.dumps(values))
    with pytest.raises((InputFileError, DepthError)) as caught:
        load_depth_scale(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("typed_share", [0.5, 0.8, 25.4 / 30, 1.12, 30 / 25, 2.0, 10.0])
def test_a_board_of_another_size_than_given_is_refused(typed_share: float) -> None:
    readings = [
        TargetReadings(target.name, target.true_m * typed_share, target.measured_m)
        for target in targets(1000)
    ]
    failure = fit_depth_scale(readings, side_m=0.025 * typed_share)
    assert isinstance(failure, DepthScaleFailure)
    side_mm = float(failure.reason.split("sides of ")[1].split(" mm")[0])
    assert side_mm == pytest.approx(25 / SCALE, rel=0.01)
    assert "or the depth is in" in failure.reason


@pytest.mark.parametrize("unit_mm", [0.1, 10, 25.4])
def test_depth_in_another_unit_is_refused_and_the_unit_named(unit_mm: float) -> None:
    readings = [
        TargetReadings(target.name, target.true_m, target.measured_m / unit_mm)
        for target in targets(1000)
    ]
    failure = fit_depth_scale(readings)
    assert isinstance(failure, DepthScaleFailure)
    assert f"units of {unit_mm:g} mm" in failure.reason


def test_a_scale_that_makers_do_not_state_is_told() -> None:
    assert tell_scale(1.015, 0.002) == (None, None)
    refused, told = tell_scale(0.96, 0.002, side_m=0.024)
    assert refused is None
    assert told is not None
    assert "sides of 25 mm instead of the 24 mm given would explain it" in told
    refused, told = tell_scale(1.0, 0.04)
    assert refused is None
    assert told is not None
    assert "only known within 8%" in told
    assert tell_scale(1.2, 1.0)[0] is not None
