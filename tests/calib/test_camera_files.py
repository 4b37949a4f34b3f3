"""Camera files of OpenCV and ROS."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from camera_files import assert_recognised, assert_refused, write

from basetree.errors import InputFileError
from calib import CameraError, PinholeCamera, load_camera

ROS = """\
image_width: 640
image_height: 480
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [526.69, 0, 312.33, 0, 525.75, 246.22,
         0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [0.0186, -0.0807, 6.7e-4, -1.8e-03, 1e-05]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [516.2, 0, 310.36, 0, 0, 514.04, 246.88, 0, 0, 0, 1, 0]
"""
ROS_CAMERA = PinholeCamera(
    640, 480, 526.69, 525.75, 312.33, 246.22, (0.0186, -0.0807, 6.7e-4, -1.8e-3, 1e-5)
)

OPENCV = """\
%YAML:1.0
---
calibration_time: "Tue Mar  5 14:21:38 2024"
nr_of_frames: 23
image_width: 1280
image_height: 720
board_width: 9
square_size: 5.0000000745058060e-02
# flags:  +fix_aspect_ratio
flags: 2
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 9.0512e+02, 0., 6.3985e+02, 0., 9.0371e+02, 3.6271e+02, 0., 0.,
       1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 1.25e-01, -2.5e-01, 1.5e-03, -7.5e-04, 0. ]
avg_reprojection_error: 2.1341e-01
"""
OPENCV_CAMERA = PinholeCamera(
    1280, 720, 905.12, 903.71, 639.85, 362.71, (0.125, -0.25, 1.5e-3, -7.5e-4, 0.0)
)
OPENCV_XML = """\
<?xml version="1.0"?>
<opencv_storage>
<calibration_time>"Tue Mar  5 14:21:38 2024"</calibration_time>
<image_width>1280</image_width>
<image_height>720</image_height>
<!-- flags:  +fix_aspect_ratio -->
<flags>2</flags>
<cameraMatrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    9.0512e+02 0. 6.3985e+02 0. 9.0371e+02 3.6271e+02 0. 0. 1.</data></cameraMatrix>
<distCoeffs type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    1.25e-01 -2.5e-01 1.5e-03 -7.5e-04 0.</data></distCoeffs>
<images>
  <_>left01.png</_>
  <_>left02.png</_></images>
</opencv_storage>
"""

PARAMETERS = """\
/**:
  ros__parameters:

    sensors:
      imu:
        rate: 400.
      cam_front: # front
        C_r_CL: [0.0006, -0.0641, -0.0544]

        image_width: 1440
        image_height: 1080

        fisheye: # from calib_cam0.yaml
          topic: "/driver/cam0"
          K: [693.89, 0.0, 719.56, 0.0, 693.39, 533.91, 0.0, 0.0, 1.0]
          D: [-0.0346, -0.0099, 0.0072, -0.0024]
      cam_left:
        image_width: 1440
        image_height: 1080
        fisheye:
          K: [694.78, 0.0, 724.59, 0.0, 694.01, 533.99, 0.0, 0.0, 1.0]
          D: [-0.0396, -0.0022, 0.0006, -0.0004]
"""

# OpenCV 2's calibration program
OPENCV_2 = """\
<?xml version="1.0"?>
<opencv_storage>
<calibration_Time>"Fri 24 Oct 2014 10:12:07 AM CEST"</calibration_Time>
<nrOfFrames>25</nrOfFrames>
<image_Width>1280</image_Width>
<image_Height>720</image_Height>
<board_Width>9</board_Width>
<board_Height>6</board_Height>
<square_Size>50.</square_Size>
<FixAspectRatio>1.</FixAspectRatio>
<flagValue>14</flagValue>
<Camera_Matrix type_id="opencv-matrix">
  <rows>3</rows>
  <cols>3</cols>
  <dt>d</dt>
  <data>
    9.0512e+02 0. 6.3985e+02 0. 9.0371e+02 3.6271e+02 0. 0. 1.</data></Camera_Matrix>
<Distortion_Coefficients type_id="opencv-matrix">
  <rows>5</rows>
  <cols>1</cols>
  <dt>d</dt>
  <data>
    1.25e-01 -2.5e-01 1.5e-03 -7.5e-04 0.</data></Distortion_Coefficients>
<Avg_Reprojection_Error>1.8e-01</Avg_Reprojection_Error>
</opencv_storage>
"""

KNOWN = [
    ("ros.yaml", ROS, None, ROS_CAMERA),
    ("ros.yaml", f"{ROS}---\n", None, ROS_CAMERA),
    ("ros.yaml", ROS, "narrow_stereo/left", ROS_CAMERA),
    ("opencv.yml", OPENCV, None, OPENCV_CAMERA),
    ("opencv5.yml", OPENCV.replace("%YAML:1.0", "%YAML 1.2"), None, OPENCV_CAMERA),
    ("opencv.xml", OPENCV_XML, None, OPENCV_CAMERA),
    ("opencv2.xml", OPENCV_2, None, OPENCV_CAMERA),
    (
        "sensors.yaml",
        PARAMETERS,
        "cam_front",
        PinholeCamera(
            1440,
            1080,
            693.89,
            693.39,
            719.56,
            533.91,
            (-0.0346, -0.0099, 0.0072, -0.0024),
            "fisheye",
        ),
    ),
]


@pytest.mark.parametrize(("file", "text", "name", "expected"), KNOWN)
def test_known_files_are_recognised_by_their_content(
    tmp_path: Path, file: str, text: str, name: str | None, expected: PinholeCamera
) -> None:
    assert_recognised(tmp_path, file, text, name, expected)


@pytest.mark.parametrize("suffix", [".yml", ".xml"])
@pytest.mark.parametrize(
    ("terms", "fisheye", "kept"),
    [
        ([0.1, -0.2, 1e-3, 2e-5, 0.03], 0, 5),
        ([0.6, 0.1, 1e-3, -1e-3, 0.01, 0.7, 0.15, 0.02, 0, 0, 0, 0, 0, 0], 0, 8),
        ([0, 0, 0, 0, 0], 0, 0),
        ([0.01, 1e-5, -0.002, 3e-4], 1, 4),
    ],
)
def test_what_opencv_writes_is_read(
    tmp_path: Path, suffix: str, terms: list[float], fisheye: int, kept: int
) -> None:
    matrix = np.array([[612.345678901234, 0, 320.1], [0, 611.9, 239.8], [0, 0, 1]])
    storage = cv2.FileStorage(str(tmp_path / f"camera{suffix}"), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480), ("fisheye_model", fisheye)):
        storage.write(name, value)
    storage.write("camera_matrix", matrix)
    storage.write("distortion_coefficients", np.array([terms]))
    storage.release()
    model = "fisheye" if fisheye else "radtan"
    assert load_camera(tmp_path / f"camera{suffix}") == PinholeCamera(
        640, 480, matrix[0, 0], 611.9, 320.1, 239.8, tuple(terms[:kept]), model
    )


@pytest.mark.parametrize(
    ("model", "terms", "expected"),
    [
        ("plumb_bob", [0, 0, 0, 0, 0], ((), "radtan")),
        ("plumb_bob", [], ((), "radtan")),
        ("rational_polynomial", [0.1] * 8, ((0.1,) * 8, "radtan")),
        ("equidistant", [0.1] * 4, ((0.1,) * 4, "fisheye")),
        ("equidistant", [0] * 4, ((0.0,) * 4, "fisheye")),
    ],
)
def test_ros_names_its_lens_models(
    tmp_path: Path, model: str, terms: list[float], expected: tuple[Any, str]
) -> None:
    text = ROS.replace("plumb_bob", model).replace("cols: 5", f"cols: {len(terms)}")
    text = text.replace("[0.0186, -0.0807, 6.7e-4, -1.8e-03, 1e-05]", str(terms))
    camera = load_camera(write(tmp_path, "ros.yaml", text))
    assert (camera.distortion, camera.distortion_model) == expected


def test_intrinsics_for_larger_images_are_scaled(tmp_path: Path) -> None:
    camera = load_camera(write(tmp_path, "sensors.yaml", PARAMETERS), name="cam_left")
    half = camera.scaled(720, 540)
    assert (half.fx, half.cx) == (694.78 / 2, (724.59 + 0.5) / 2 - 0.5)
    with pytest.raises(CameraError, match="1440x1080 px and the image is 640x360"):
        camera.scaled(640, 360)


def test_published_rigs_are_read(shared_path: Callable[[str], Path]) -> None:
    paths = sorted(shared_path("data/digiforests").glob("*.yaml"))
    assert paths
    for path in paths:
        for name in ("cam_front", "cam_left", "cam_right"):
            camera = load_camera(path, name=name)
            assert (camera.width, camera.height) == (1440, 1080)
            assert camera.distortion_model == "fisheye"
            assert 690 < camera.fx < 702
            assert camera.scaled(720, 540).fx == camera.fx / 2


BROKEN = [
    # several cameras, or none of that name
    (OPENCV, "left", "has no camera 'left', expected no name for its only camera"),
    # unsupported camera models
    (
        ROS.replace("plumb_bob", "double_sphere"),
        None,
        "distortion_model is 'double_sphere': expected",
    ),
    (
        OPENCV.replace("rows: 5", "rows: 14").replace(", 0. ]", ", 0." + ", 1." * 9 + " ]"),
        None,
        "the sensor is tilted by 57.3 degrees",
    ),
    (ROS.replace("plumb_bob", "[plumb_bob]"), None, "distortion_model is ['plumb_bob']: expected"),
    # missing fields, or values that are not numbers
    (ROS.replace("image_width: 640\n", ""), None, "image_width is missing: expected a number"),
    (ROS.replace("image_width: 640", "image_width: wide"), None, "image_width is 'wide'"),
    (ROS.replace("image_width: 640", "image_width: 640.5"), None, "expected whole pixels"),
    (
        OPENCV.replace("distortion_coefficients", "lens"),
        None,
        "distortion_coefficients or distCoeffs",
    ),
    # contradictory fields
    (ROS.replace("0, 0, 1]\ndist", "0, 0, 1, 0]\ndist"), None, "has 10 numbers: expected 9"),
    (
        ROS.replace("rows: 3\n  cols: 3\n  data: [526.69, 0,", "data: [526.69,"),
        None,
        "camera_matrix has 8 numbers: expected 3x3",
    ),
    (ROS.replace("[526.69, 0,", "[526.69, 0.5,"), None, "camera_matrix has a skew of 0.5"),
    (PARAMETERS.replace("0.0, 0.0, 1.0]", "0.0, 0.0, 2.0]"), "cam_left", "as its last row"),
    (OPENCV + "cameraMatrix: [1]\n", None, "camera_matrix and cameraMatrix are both given"),
    (ROS + "distortion_coeffs: [0, 0, 0, 0]\n", None, "are both given: expected one of them"),
    (ROS + "image_width: 320\n", None, "image_width is given twice"),
    (
        OPENCV_2.replace(
            "<flag", "<image_width>640</image_width><image_height>1</image_height><flag"
        ),
        None,
        "the image size is 640x1 and 1280x720: expected one",
    ),
    (ROS + "resolution: [320, 240]\n", None, "the image size is 320x240 and 640x480: expected"),
    (
        PARAMETERS.replace("      cam_left:", "        radtan: {K: [1], D: [1]}\n      cam_left:"),
        "cam_front",
        "fisheye and radtan both hold K and D",
    ),
    (ROS.replace("data: [526.69", "values: [526.69"), None, "camera_matrix is None: expected a"),
    (OPENCV.replace("fisheye_model: 0", "fisheye_model: 7"), None, "fisheye_model is 7"),
    # text in no known format
    ("", None, "no known camera format, expected one of calib.camera/1, ROS camera_info, ROS"),
    ("just words", None, "no known camera format"),
    ("width: 640\nheight: 480\n", None, "no known camera format"),
    ("a: [1, 2", None, "not YAML"),
    ("<opencv_storage><a></opencv_storage>", None, "not XML"),
    ("<s><a>1</a><a>2</a></s>", None, "a is given twice"),
    ("a: 1\n---\nb: 2\n", None, "no known camera format"),
    ("[LEFT_CAM_HD]\nfx\n", None, "not INI"),
    ('{"schema": 1, "schema": 2}', None, "schema is given twice"),
]


@pytest.mark.parametrize(("text", "name", "message"), BROKEN)
def test_broken_and_contradictory_files_get_one_line(
    tmp_path: Path, text: str, name: str | None, message: str
) -> None:
    assert_refused(tmp_path, text, name, message)


def test_binary_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "image.png"
    path.write_bytes(b"\x89PNG\r\n\x1a\n\xff\xfe")
    with pytest.raises(InputFileError, match=r"image\.png: not a text file, expected a camera"):
        load_camera(path)
