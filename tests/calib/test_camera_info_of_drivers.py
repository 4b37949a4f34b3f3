"""camera_info as drivers write it: names of lenses, sizes of 0, regions, binning, P alone."""

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from calib import CameraError, PinholeCamera, load_camera, project_points
from calib.files import ros
from calib.sizeless import SizelessCamera

K = [410.0, 0.0, 318.25, 0.0, 411.0, 241.5, 0.0, 0.0, 1.0]
P = [400.0, 0.0, 322.0, -20.0, 0.0, 400.0, 238.0, 0.0, 0.0, 0.0, 1.0, 0.0]
FOUR = [0.02, -0.01, 0.0005, -0.0004]
POINTS_M = np.array([[0.3, -0.2, 1.0], [-0.4, 0.25, 1.2], [0.0, 0.0, 2.0]])


def message(**fields: Any) -> dict[str, Any]:
    """A message with a 640x480 image and no lens."""
    plain: dict[str, Any] = {"width": 640, "height": 480, "distortion_model": "", "d": [], "k": K}
    return plain | fields


def info(folder: Path, **fields: Any) -> Path:
    """A camera_info file of a 640x480 image."""
    plain: dict[str, Any] = {
        "image_width": 640,
        "image_height": 480,
        "camera_name": "c",
        "camera_matrix": {"rows": 3, "cols": 3, "data": K},
        "distortion_model": "plumb_bob",
        "distortion_coefficients": {"rows": 1, "cols": 4, "data": FOUR},
        "projection_matrix": {"rows": 3, "cols": 4, "data": P},
    }
    path = folder / "info.yaml"
    path.write_text(yaml.safe_dump(plain | fields))
    return path


@pytest.mark.parametrize(
    "name", ["plumb bob", "Plumb-Bob", "radtan", "Brown Conrady", "BROWN_CONRADY"]
)
@pytest.mark.parametrize("prefix", ["", "distortion.", "RS2_DISTORTION_"])
def test_names_of_the_radial_tangential_lens(prefix: str, name: str) -> None:
    camera = ros.build_message(message(distortion_model=f"{prefix}{name}", d=FOUR))
    assert (camera.distortion_model, camera.distortion) == ("radtan", tuple(FOUR))


@pytest.mark.parametrize("name", ["fisheye", "equidistant", "Kannala Brandt4", "kannala_brandt"])
def test_names_of_the_fisheye_lens(name: str) -> None:
    camera = ros.build_message(message(distortion_model=name, d=[*FOUR, 0.0]))
    assert (camera.distortion_model, camera.distortion) == ("fisheye", tuple(FOUR))


@pytest.mark.parametrize(
    "name", ["None", "none", None, "", "Inverse Brown Conrady", "Modified Brown Conrady", "own"]
)
@pytest.mark.parametrize("terms", [[], [0.0] * 5])
def test_terms_of_0_are_no_distortion_whatever_the_name(
    name: str | None, terms: list[float]
) -> None:
    camera = ros.build_message(message(distortion_model=name, d=terms))
    assert camera == PinholeCamera(640, 480, K[0], K[4], K[2], K[5])


def test_a_fisheye_lens_of_0_still_bends() -> None:
    camera = ros.build_message(message(distortion_model="equidistant", d=[0.0] * 4))
    assert camera.distortion == (0.0,) * 4


@pytest.mark.parametrize(
    "name",
    ["omni", "mei", "double_sphere", "thin_prism_fisheye", "Kannala Brandt 8", "equirectangular"],
)
def test_other_wide_lenses_bend_with_terms_of_0_too(name: str) -> None:
    with pytest.raises(CameraError, match="expected plumb_bob"):
        ros.build_message(message(distortion_model=name, d=[0.0] * 5))


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("Inverse Brown Conrady", "have another meaning"),
        ("none", "expected terms of 0"),
        ("own", "'own': expected plumb_bob, rational_polynomial or equidistant"),
        (7, "distortion_model is 7: expected plumb_bob"),
    ],
)
def test_terms_of_other_formulas_are_refused(name: object, expected: str) -> None:
    with pytest.raises(CameraError, match=expected):
        ros.build_message(message(distortion_model=name, d=FOUR))


@pytest.mark.parametrize("names", [("k", "p"), ("K", "P")])
@pytest.mark.parametrize("matrix", [[0.0] * 9, None])
def test_p_alone_is_a_rectified_camera(
    names: tuple[str, str], matrix: list[float] | None, caplog: pytest.LogCaptureFixture
) -> None:
    values = message(**{names[1]: P}, d=FOUR)
    del values["k"]
    values |= {} if matrix is None else {names[0]: matrix}
    assert ros.build_message(values) == PinholeCamera(640, 480, 400, 400, 322, 238)
    assert "taken for rectified pictures" in caplog.text


def test_p_alone_in_a_file_is_a_rectified_camera(tmp_path: Path) -> None:
    path = info(tmp_path, camera_matrix={"rows": 3, "cols": 3, "data": [0.0] * 9})
    assert load_camera(path) == PinholeCamera(640, 480, 400, 400, 322, 238)


def test_a_region_moves_the_centre(caplog: pytest.LogCaptureFixture) -> None:
    region = {"x_offset": 100, "y_offset": 40, "width": 400, "height": 300, "do_rectify": False}
    camera = ros.build_message(message(roi=region, d=FOUR, distortion_model="plumb_bob"))
    whole = ros.build_message(message(d=FOUR, distortion_model="plumb_bob"))
    assert (camera.width, camera.height) == (400, 300)
    moved = project_points(whole, POINTS_M) - project_points(camera, POINTS_M)
    np.testing.assert_allclose(moved, [[100, 40]] * 3)
    assert "roi is 400x300 px at (100, 40)" in caplog.text


@pytest.mark.parametrize("binning", [(2, 2), (4, 2), (0, 0), (1, 1), (0, 2)])
def test_binning_scales_about_the_corner(binning: tuple[int, int]) -> None:
    region = {"x_offset": 100, "y_offset": 40, "width": 400, "height": 300}
    columns, rows = binning
    camera = ros.build_message(message(roi=region, binning_x=columns, binning_y=rows))
    scale = np.array([max(columns, 1), max(rows, 1)])
    assert (camera.width, camera.height) == tuple(np.array([400, 300]) // scale)
    expected = (project_points(ros.build_message(message()), POINTS_M) - [100, 40]) / scale
    np.testing.assert_allclose(project_points(camera, POINTS_M), expected)


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        ({"roi": {"x_offset": 300, "y_offset": 0, "width": 400, "height": 300}}, "inside the cam"),
        ({"roi": {"x_offset": 30, "y_offset": 0}}, "the crop is 0x0 px at (30, 0)"),
        ({"roi": {"x_offset": -3, "width": 40, "height": 30}}, "x_offset is -3: expected 0 to"),
        ({"roi": {"width": 1e300, "height": 1e300}}, "width is 1e+300: expected 0 to 100000"),
        ({"binning_x": 0.5}, "binning_x is 0.5: expected 0 to 100000 whole pixels"),
        ({"binning_x": 641}, "binning is 641x1: expected 1x1 or more, and at most"),
        ({"k": [0.0] * 9, "p": P[:9]}, "p has 9 numbers: expected 3x4"),
        ({"k": [0.0] * 9, "p": [0.0] * 12}, "k is all 0, ROS's mark"),
    ],
)
def test_regions_and_matrices_that_do_not_fit_are_refused(
    fields: dict[str, Any], expected: str
) -> None:
    with pytest.raises(CameraError) as caught:
        ros.build_message(message(**fields))
    assert expected in str(caught.value)


@pytest.mark.parametrize("fields", [{"image_width": 0, "image_height": 0}])
def test_a_size_of_0_is_that_of_the_pictures(
    tmp_path: Path, fields: dict[str, int], caplog: pytest.LogCaptureFixture
) -> None:
    camera = load_camera(info(tmp_path, **fields))
    assert isinstance(camera, SizelessCamera)
    assert "info.yaml (c): it gives no image size" in caplog.text
    expected = PinholeCamera(648, 484, K[0], K[4], K[2], K[5], tuple(FOUR))
    assert camera.scaled(648, 484) == expected


def test_pictures_of_a_simple_scale_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    camera = load_camera(info(tmp_path, image_width=0, image_height=0))
    expected = load_camera(info(tmp_path)).scaled(1280, 960)
    assert camera.scaled(1280, 960) == expected
    assert "is taken scaled by 2/1 for pictures of 1280x960 px" in caplog.text


@pytest.mark.parametrize("size", [(1280, 480), (800, 600), (64, 48)])
def test_pictures_of_another_size_are_refused(tmp_path: Path, size: tuple[int, int]) -> None:
    camera = load_camera(info(tmp_path, image_width=0, image_height=0))
    with pytest.raises(CameraError, match=f"not for images of {size[0]}x{size[1]} px"):
        camera.scaled(*size)


@pytest.mark.parametrize("centre", [-5.0, 0.0, 1e300])
def test_a_camera_without_a_size_has_its_centre_inside(centre: float) -> None:
    values = message(width=0, height=0, k=[400, 0, centre, 0, 400, 240, 0, 0, 1])
    with pytest.raises(CameraError, match="expected a point inside the image"):
        ros.build_message(values)


def test_what_is_not_a_choice_is_not_said(caplog: pytest.LogCaptureFixture) -> None:
    whole = {"x_offset": 0, "y_offset": 0, "width": 640, "height": 480}
    with caplog.at_level(logging.WARNING):
        ros.build_message(message(roi=whole, p=P, binning_x=1, binning_y=1))
    assert not caplog.records
