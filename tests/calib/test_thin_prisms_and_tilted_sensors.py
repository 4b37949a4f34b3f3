"""OpenCV's lenses of 12 and 14 terms, as factories of stereo cameras write them."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib import (
    CameraError,
    PinholeCamera,
    RigidTransform,
    load_camera,
    pixels_to_rays,
    project_points,
    rectify,
    register_depth,
    save_camera,
)
from calib.files import ros

RATIONAL = (0.31, -4.2, 0.0011, -0.0006, 3.9, 0.29, -4.15, 3.85)
PRISM = (*RATIONAL, 0.0021, -0.0009, -0.0013, 0.0004)
LENSES = [PRISM, (*PRISM, 0.021, -0.013), (*RATIONAL, 0, 0, 0, 0, -0.03, 0.008)]
PIXELS = np.stack(np.meshgrid(np.linspace(2, 638, 23), np.linspace(2, 358, 13)), -1).reshape(-1, 2)


def camera_of(terms: tuple[float, ...]) -> PinholeCamera:
    return PinholeCamera(640, 360, 498.0, 497.0, 322.0, 177.0, terms)


@pytest.mark.parametrize("terms", LENSES)
def test_points_project_as_in_opencv(terms: tuple[float, ...]) -> None:
    camera = camera_of(terms)
    points_m = pixels_to_rays(camera_of(()), PIXELS) * 3.0
    matrix = np.array([[498.0, 0, 322], [0, 497, 177], [0, 0, 1]])
    found = cv2.projectPoints(
        points_m[:, None], np.zeros(3), np.zeros(3), matrix, np.array(terms, float)
    )[0]
    np.testing.assert_allclose(
        project_points(camera, points_m), found.reshape(-1, 2) + 0.5, atol=1e-9
    )


@pytest.mark.parametrize("terms", LENSES)
def test_every_pixel_has_its_ray(terms: tuple[float, ...]) -> None:
    camera = camera_of(terms)
    again = project_points(camera, pixels_to_rays(camera, PIXELS))
    np.testing.assert_allclose(again, PIXELS, atol=1e-6)


def test_a_rectified_line_is_straight() -> None:
    camera = camera_of(LENSES[1])
    points_m = np.stack([np.linspace(-1, 1, 41), np.full(41, 0.4), np.full(41, 2.0)], -1)
    image = np.zeros((360, 640), np.uint8)
    for column, row in project_points(camera, points_m) - 0.5:
        image[round(row), round(column)] = 255
    undone = rectify(camera)
    expected_px = project_points(undone.camera, points_m)
    rows, columns = np.nonzero(undone.image(image) > 60)
    for row, column in zip(rows, columns, strict=True):
        off = np.abs(expected_px - 0.5 - [column, row]).max(1).min()
        assert off < 1.6


def test_depth_is_registered_into_a_tilted_camera() -> None:
    plain, camera = camera_of(()), camera_of(LENSES[1])
    depth_m = np.full((360, 640), 2.5, np.float32)
    found = register_depth(depth_m, plain, camera, RigidTransform.identity())
    inner = found[30:-30, 40:-40]
    np.testing.assert_allclose(inner, 2.5, rtol=1e-5)


@pytest.mark.parametrize("terms", LENSES)
def test_files_keep_the_terms(tmp_path: Path, terms: tuple[float, ...]) -> None:
    camera = camera_of(terms)
    save_camera(tmp_path / "c.json", camera)
    assert load_camera(tmp_path / "c.json") == camera
    k = [498.0, 0, 322.0, 0, 497.0, 177.0, 0, 0, 1]
    values = {"width": 640, "height": 360, "k": k, "d": list(terms)}
    message = ros.build_message(values | {"distortion_model": "rational_polynomial"})
    assert message == camera


@pytest.mark.parametrize(
    ("zeros", "kept"), [(4, RATIONAL), (6, RATIONAL), (2, (*RATIONAL, 0.001, 0.0, 0.0, 0.0))]
)
def test_terms_of_0_at_the_end_are_dropped(
    tmp_path: Path, zeros: int, kept: tuple[float, ...]
) -> None:
    given = [*RATIONAL, *([0.001, 0.0, 0.0, 0.0] if zeros == 2 else []), *[0.0] * zeros]
    values = {"distortion_model": "rational_polynomial", "d": given, "width": 640, "height": 360}
    path = tmp_path / "info.json"
    path.write_text(json.dumps(values | {"k": [498, 0, 322, 0, 497, 177, 0, 0, 1]}))
    assert load_camera(path).distortion == kept


@pytest.mark.parametrize(
    ("terms", "message"),
    [
        ((*RATIONAL, 0, 0, 0, 0, 1.2, 0), "the sensor is tilted by 68.8 degrees"),
        ((*RATIONAL, 0, 0, 0, 0, 0, 1e300), "the sensor is tilted by"),
        ((*RATIONAL, 1e300, 0, 0, 0), "gives one ray for only"),
        ((*RATIONAL, 9.0, 0, 0, 0), "gives one ray for only"),
        ((*RATIONAL, 0.1), "has 9 terms: expected none, 4"),
        ((*PRISM, 0.1), "has 13 terms: expected none, 4"),
    ],
)
def test_lenses_that_cannot_be_are_refused(terms: tuple[float, ...], message: str) -> None:
    with pytest.raises(CameraError, match=message):
        camera_of(terms)
