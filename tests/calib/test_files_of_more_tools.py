"""Camera files of more tools: ost.txt, pairs, OAK cameras, phones; and what is not read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from camera_files import assert_recognised, assert_refused, write

from calib import PinholeCamera, load_camera

LENS = (-0.21, 0.07, 0.0003, -0.0004, 0.0)
CAMERA = PinholeCamera(800, 600, 612.5, 613.25, 403.0, 297.5, LENS)
LEFT = [612.5, 0.0, 403.0, 0.0, 613.25, 297.5, 0.0, 0.0, 1.0]
RIGHT = [610.0, 0.0, 396.0, 0.0, 610.5, 301.0, 0.0, 0.0, 1.0]
RIGHT_CAMERA = PinholeCamera(800, 600, 610.0, 610.5, 396.0, 301.0, LENS)


def ini(heading: str, terms: str = "-0.21 0.07 0.0003 -0.0004 0", k: str = "612.5 0 403") -> str:
    return f"""\
[{heading}]

camera matrix
{k}
0 613.25 297.5
0 0 1

distortion
{terms}

rectification
1 0 0
0 1 0
0 0 1

projection
600 0 400 0
0 600 300 0
0 0 1 0
"""


SIZE = "# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n800\n\nheight\n600\n\n"


def mat(name: str, values: list[float] | tuple[float, ...], rows: int) -> str:
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {len(values) // rows}\n   dt: d\n"
        f"   data: {list(values)}\n"
    )


def pair(names: tuple[str, str, str, str], size: str = "") -> str:
    k1, d1, k2, d2 = names
    left = mat(k1, LEFT, 3) + mat(d1, LENS, 1)
    return "%YAML:1.0\n---\n" + size + left + mat(k2, RIGHT, 3) + mat(d2, LENS, 1)


def oak(**fields: Any) -> str:
    colour = {
        "cameraType": 0,
        "width": 800,
        "height": 600,
        "intrinsicMatrix": [LEFT[:3], LEFT[3:6], LEFT[6:]],
        "distortionCoeff": [*LENS, *[0.0] * 9],
        "lensPosition": 130,
    }
    second = {"cameraType": 1, "distortionCoeff": [0.02, -0.01, 0.003, -0.001, *[0.0] * 10]}
    data = [[0, colour | fields], [1, colour | second]]
    return json.dumps({"batchName": "", "cameraData": data, "version": 7})


RECORD3D = {"w": 800, "h": 600, "K": [612.5, 0, 0, 0, 613.25, 0, 403.0, 297.5, 1], "fps": 60}
ROWS = "612.5, 0.0, 403.0\n0.0, 613.25, 297.5\n0.0, 0.0, 1.0\n"
PLAIN = PinholeCamera(800, 600, 612.5, 613.25, 403.0, 297.5)
FISHEYE = PinholeCamera(
    800, 600, 612.5, 613.25, 403.0, 297.5, (0.02, -0.01, 0.003, -0.001), "fisheye"
)
RATIONAL = (0.3, 0.1, 0.001, -0.001, 0.01, 0.4, 0.15, 0.02)


@pytest.mark.parametrize(
    ("file", "text", "name", "expected"),
    [
        ("ost.txt", SIZE + ini("narrow_stereo"), None, CAMERA),
        ("ost.txt", SIZE + ini("narrow_stereo"), "narrow_stereo", CAMERA),
        ("ost.ini", ini("a/left") + SIZE + ini("a/right"), "left", CAMERA),
        ("ost.ini", SIZE + ini("a/left") + ini("a/right"), "a/right", CAMERA),
        (
            "ost.txt",
            SIZE + ini("c", " ".join(map(str, RATIONAL))),
            None,
            PinholeCamera(800, 600, 612.5, 613.25, 403.0, 297.5, RATIONAL),
        ),
    ],
)
def test_ost_files(
    tmp_path: Path, file: str, text: str, name: str | None, expected: PinholeCamera
) -> None:
    assert_recognised(tmp_path, file, text, name, expected)


@pytest.mark.parametrize(
    "names",
    [
        ("K_LEFT", "D_LEFT", "K_RIGHT", "D_RIGHT"),
        ("M1", "D1", "M2", "D2"),
        ("K1", "D1", "K2", "D2"),
        ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
        ("camera_matrix_left", "dist_coeffs_left", "camera_matrix_right", "dist_coeffs_right"),
        ("left_K", "left_D", "right_K", "right_D"),
        ("mtxL", "distL", "mtxR", "distR"),
        ("K0", "D0", "K1", "D1"),
    ],
)
def test_both_cameras_of_a_pair(tmp_path: Path, names: tuple[str, str, str, str]) -> None:
    path = write(tmp_path, "stereo.yml", pair(names, "Size: [800, 600]\n"))
    assert load_camera(path, name=names[0]) == CAMERA
    assert load_camera(path, name="left") == CAMERA
    assert load_camera(path, name=names[2]) == RIGHT_CAMERA
    assert load_camera(path, name="right") == RIGHT_CAMERA
    assert_refused(tmp_path, path.read_text(), None, f"one of the names '{names[0]}', '{names[2]}'")


def test_a_pair_without_a_size_takes_that_of_the_pictures(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path, "intrinsics.yml", pair(("M1", "D1", "M2", "D2")))
    assert load_camera(path, name="M2").scaled(800, 600) == RIGHT_CAMERA
    assert f"{path} (M2): it gives no image size" in caplog.text


@pytest.mark.parametrize(
    ("text", "name", "expected"),
    [
        (oak(distortionCoeff=[0.0] * 14), "CAM_A", PLAIN),
        (oak(), "cam_b", FISHEYE),
        (json.dumps(RECORD3D), None, PLAIN),
        (json.dumps(RECORD3D | {"K": LEFT}), None, PLAIN),
        (
            "%YAML:1.0\n---\n"
            + mat("M", LEFT, 3)
            + mat("D", FISHEYE.distortion, 1)
            + "width: 800\nheight: 600\ndistortion_model: fisheye\n",
            None,
            FISHEYE,
        ),
    ],
)
def test_devices(tmp_path: Path, text: str, name: str | None, expected: PinholeCamera) -> None:
    assert_recognised(tmp_path, "camera.json", text, name, expected)


def test_the_terms_of_an_oak_camera(tmp_path: Path) -> None:
    terms = [*RATIONAL, 0.0, 0.0, 0.0, 0.0, -0.02, 0.01]
    path = write(tmp_path, "calib.json", oak(distortionCoeff=terms))
    assert load_camera(path, name="CAM_A").distortion == tuple(terms)


@pytest.mark.parametrize(
    "text",
    [
        ROWS,
        ROWS.replace(",", " "),
        ROWS.replace(", ", ","),
        "[[612.5 0 403.0]\n [0 6.1325e+02 297.5]\n [0 0 1]]\n",
        f"# numpy\n{ROWS}",
    ],
)
def test_three_rows_of_numbers(tmp_path: Path, text: str, caplog: pytest.LogCaptureFixture) -> None:
    assert load_camera(write(tmp_path, "k.csv", text)).scaled(800, 600) == PLAIN
    assert "taken for a camera without distortion" in caplog.text


@pytest.mark.parametrize(
    ("size", "is_known"),
    [
        ({"image_size": [800, 600]}, True),
        ({"imageSize": [800, 600]}, True),
        ({"img_size": "800 600"}, True),
        ({"imageWidth": 800, "imageHeight": 600}, True),
        ({"width": 0, "height": 0, "image_size": [800, 600]}, True),
        ({"image_size": {"a": 1}}, False),
        ({}, False),
    ],
)
def test_the_size_by_its_other_names(tmp_path: Path, size: dict[str, Any], is_known: bool) -> None:
    rows = [LEFT[:3], LEFT[3:6], LEFT[6:]]
    text = json.dumps({"mtx": rows, "dist": [list(LENS)], **size})
    camera = load_camera(write(tmp_path, "calibration.json", text))
    assert (type(camera) is PinholeCamera) == is_known
    assert camera.scaled(800, 600) == CAMERA


@pytest.mark.parametrize("ending", [".xml", ".yml", ".json"])
def test_pairs_that_opencv_writes(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"stereo{ending}"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, values in (("M1", LEFT), ("D1", LENS), ("M2", RIGHT), ("D2", LENS)):
        file.write(name, np.array(values).reshape(3 if name[0] == "M" else 1, -1))
    file.release()
    assert load_camera(path, name="M1").scaled(800, 600) == CAMERA
    assert load_camera(path, name="right").scaled(800, 600) == RIGHT_CAMERA


def test_a_skew_that_nothing_sees_is_dropped(tmp_path: Path) -> None:
    text = ROWS.replace("612.5, 0.0,", "612.5, 0.02,")
    assert load_camera(write(tmp_path, "k.csv", text)).scaled(800, 600) == PLAIN
    assert_refused(tmp_path, ROWS.replace("612.5, 0.0,", "612.5, 1.5,"), None, "a skew of 1.5 px")


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        (SIZE + ini("c", "0.1 0.1 0.1 0.1"), None, "which may be those of a fisheye lens"),
        (SIZE + ini("c", k="612.5 0"), None, "camera_matrix has 8 numbers: expected 3x3"),
        (SIZE + ini("c", k="wide 0 403"), None, "no numbers below 'camera matrix'"),
        (SIZE + ini("c", terms="none"), None, "no numbers below 'distortion'"),
        (oak(cameraType=3), "CAM_A", "cameraType is 3: expected 0 (perspective) or 1 (fisheye)"),
        (
            oak(cameraType=1, distortionCoeff=[0.1] * 5),
            "CAM_A",
            "expected four terms of a fisheye lens, then 0",
        ),
        (oak(width="wide"), "CAM_A", "width is 'wide': expected a number"),
        (json.dumps(RECORD3D | {"K": LEFT[:8]}), None, "K has 8 numbers: expected 3x3"),
        ("1 OPENCV 800 600 612 613 403 297 0 0 0 0\n", None, "cameras of COLMAP are not read"),
        ("# c\n2 SIMPLE_RADIAL 800 600 612 403 297 0\n", None, "cx and cy less 0.5"),
        (json.dumps({"camera_angle_x": 0.7, "frames": []}), None, "radiance field"),
        (json.dumps({"v2 x": {"projection_type": "brown", "k1": 0}}), None, "OpenSfM are not"),
        (json.dumps({"CalibrationInformation": {"Cameras": []}}), None, "k4a_device_get_calibra"),
        ("<calibration><projection>frame</projection><f>612</f></calibration>", None, "Metashape"),
        ("Calibration results\n===\nCamera-system parameters:\ncam0:\n", None, "give the camchain"),
        (
            "cam0: {camera_model: omni, intrinsics: [1, 2, 3, 4, 5], resolution: [8, 6]}",
            None,
            "'omni': expected pinhole; calibrate again with the model pinhole-radtan",
        ),
        (
            "model_type: MEI\nprojection_parameters: {gamma1: 1}\n",
            None,
            "'MEI': expected PINHOLE or KANNALA_BRANDT; calibrate again",
        ),
    ],
)
def test_what_is_not_read_says_what_to_give(
    tmp_path: Path, text: str, name: str | None, message: str
) -> None:
    assert_refused(tmp_path, text, name, message)


@pytest.mark.parametrize("names", [("K", "D"), ("M1", "D1"), ("camera_matrix", "dist_coeffs")])
def test_four_terms_without_a_model_are_told(
    tmp_path: Path, names: tuple[str, str], caplog: pytest.LogCaptureFixture
) -> None:
    """OpenCV's programs for fisheye lenses save four terms too, and name no model."""
    values = {
        names[0]: [[600, 0, 320], [0, 600, 240], [0, 0, 1]],
        names[1]: [[0.01], [0.02], [0.003], [0.001]],
        "width": 640,
        "height": 480,
    }
    path = write(tmp_path, "camera.json", json.dumps(values))
    assert load_camera(path).distortion == (0.01, 0.02, 0.003, 0.001)
    assert "its 4 terms are taken for k1 k2 p1 p2" in caplog.text
    caplog.clear()
    path = write(tmp_path, "camera.json", json.dumps(values | {"fisheye_model": 1}))
    assert load_camera(path).distortion_model == "fisheye"
    assert "4 terms" not in caplog.text


@pytest.mark.parametrize("names", [("cameraMatrix", "distCoeffs"), ("M1", "D1")])
def test_a_named_model_is_taken_under_all_names(tmp_path: Path, names: tuple[str, str]) -> None:
    values = {
        names[0]: [[600, 0, 320], [0, 600, 240], [0, 0, 1]],
        names[1]: [0.01, 0.02, 0.003, 0.001],
        "width": 640,
        "height": 480,
    }
    path = write(tmp_path, "camera.json", json.dumps(values | {"distortion_model": "equidistant"}))
    assert load_camera(path).distortion_model == "fisheye"
    path = write(tmp_path, "camera.json", json.dumps(values | {"distortion_model": "plumb_bob"}))
    assert load_camera(path).distortion_model == "radtan"
    unknown = json.dumps(values | {"distortion_model": "ftheta"})
    assert_refused(tmp_path, unknown, None, "distortion_model is 'ftheta'")
