"""Settings files of ORB-SLAM2 and ORB-SLAM3."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputFileError
from calib import CameraError, PinholeCamera, load_camera, project_points

PINHOLE = """\
%YAML:1.0

#----------------------------------------------------------------------------------
# Camera Parameters. Adjust them!
#----------------------------------------------------------------------------------
File.version: "1.0"

Camera.type: "PinHole"

# Camera calibration and distortion parameters (OpenCV)
Camera1.fx: 517.306408
Camera1.fy: 516.469215
Camera1.cx: 318.643040
Camera1.cy: 255.313989

Camera1.k1: 0.262383
Camera1.k2: -0.953104
Camera1.p1: -0.005358
Camera1.p2: 0.002628
Camera1.k3: 1.163314

# Camera resolution
Camera.width: 640
Camera.height: 480

Camera.fps: 30
Camera.RGB: 1
Stereo.b: 0.07732
RGBD.DepthMapFactor: 5000.0 # 1.0 for ROS_bag

# IMU noise
IMU.NoiseGyro: 1e-3
ORBextractor.nFeatures: 1000
Viewer.PointSize:2
"""
FISHEYE = """\
%YAML:1.0
Camera.type: "KannalaBrandt8"
Camera1.fx: 284.9501953125
Camera1.fy: 285.115295410156
Camera1.cx: 420.500213623047
Camera1.cy: 400.738098144531
Camera1.k1: -0.00530046410858631
Camera1.k2: 0.0423333682119846
Camera1.k3: -0.03949885815382
Camera1.k4: 0.00682387687265873
Camera2.fx: 285.001312255859
Camera2.fy: 284.914215087891
Camera2.cx: 411.864196777344
Camera2.cy: 403.41259765625
Camera2.k1: -0.00375203299336135
Camera2.k2: 0.0379297286272049
Camera2.k3: -0.0352463386952877
Camera2.k4: 0.00548873096704
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [ 0.999983, 0.00445005, 0.00385861, 0.0636739954352379,
            -0.00443664, 0.999984, -0.00347621, -0.000252007856033742,
            -0.00387402, 0.00345903, 0.999986, -8.87895439518616e-05,
            0.0,0.0,0.0,1.0]
Camera.width: 848
Camera.height: 800
Camera.fps: 30.
"""
RECTIFIED = """\
%YAML:1.0
Camera.type: "Rectified"
Camera1.fx: 718.856
Camera1.fy: 718.856
Camera1.cx: 607.1928
Camera1.cy: 185.2157
Camera.width: 1241
Camera.height: 376
"""
# ORB-SLAM2: no type, and values without a space before them, as OpenCV allows.
RAW_STEREO = """\
%YAML:1.0
Camera.fx: 435.2046959714599
Camera.fy: 435.2046959714599
Camera.cx: 367.4517211914062
Camera.cy: 252.2008514404297
Camera.k1: 0.0
Camera.k2: 0.0
Camera.p1: 0.0
Camera.p2: 0.0
Camera.width: 752
Camera.height: 480
Camera.bf: 47.90639384423901
LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]
Viewer.PointSize:2
"""
FIVE = (0.262383, -0.953104, -0.005358, 0.002628, 1.163314)
LEFT_TERMS = (-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0)
PINHOLE_CAMERA = PinholeCamera(640, 480, 517.306408, 516.469215, 318.64304, 255.313989, FIVE)
KNOWN = [
    (PINHOLE, None, PINHOLE_CAMERA),
    (PINHOLE.replace("Camera1.", "Camera."), "Camera", PINHOLE_CAMERA),
    (
        FISHEYE,
        "Camera2",
        PinholeCamera(
            848,
            800,
            285.001312255859,
            284.914215087891,
            411.864196777344,
            403.41259765625,
            (-0.00375203299336135, 0.0379297286272049, -0.0352463386952877, 0.00548873096704),
            "fisheye",
        ),
    ),
    (RECTIFIED, "Camera1", PinholeCamera(1241, 376, 718.856, 718.856, 607.1928, 185.2157)),
    (
        RAW_STEREO,
        "Camera",
        PinholeCamera(
            752, 480, 435.2046959714599, 435.2046959714599, 367.4517211914062, 252.2008514404297
        ),
    ),
    (RAW_STEREO, "LEFT", PinholeCamera(752, 480, 458.654, 457.296, 367.215, 248.375, LEFT_TERMS)),
]
POINTS_M = np.array([[x, y, 1.0] for x in np.linspace(-0.5, 0.5, 7) for y in (-0.4, 0, 0.4)])


def write(folder: Path, text: str) -> Path:
    path = folder / "settings.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("text", "name", "expected"), KNOWN)
def test_the_cameras_of_a_settings_file_are_read_and_project_as_opencv(
    tmp_path: Path, text: str, name: str | None, expected: PinholeCamera
) -> None:
    camera = load_camera(write(tmp_path, text), name=name)
    assert camera == expected
    fisheye = expected.distortion_model == "fisheye"
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    matrix = np.array(
        [[expected.fx, 0, expected.cx], [0, expected.fy, expected.cy], [0, 0, 1]], float
    )
    lens = np.array(expected.distortion or [0.0] * 5)
    pixels = project(POINTS_M[:, None], np.zeros(3), np.zeros(3), matrix, lens)[0]
    np.testing.assert_allclose(
        project_points(camera, POINTS_M) - 0.5, pixels.reshape(-1, 2), atol=1e-6
    )


def test_opencv_reads_the_same_numbers(tmp_path: Path) -> None:
    storage = cv2.FileStorage(str(write(tmp_path, RAW_STEREO)), cv2.FILE_STORAGE_READ)
    camera = load_camera(tmp_path / "settings.yaml", name="LEFT")
    assert tuple(storage.getNode("LEFT.D").mat().ravel()) == camera.distortion
    assert storage.getNode("LEFT.K").mat()[1, 2] == camera.cy


@pytest.mark.parametrize(
    ("text", "name", "message"),
    [
        (FISHEYE, None, "holds 2 cameras, expected one of the names 'Camera1', 'Camera2'"),
        (RAW_STEREO, None, "expected one of the names 'Camera', 'LEFT'"),
        (PINHOLE.replace("Camera.width: 640\nCamera.height: 480\n", ""), None, "Camera.width and"),
        (PINHOLE.replace("PinHole", "Omni"), None, "Camera.type is 'Omni': expected PinHole"),
        (FISHEYE.replace("KannalaBrandt8", "PinHole"), "Camera1", "expected no k4 of a PinHole"),
        (PINHOLE.replace("PinHole", "Rectified"), None, "Camera1.k1 is 0.262383: expected no k1"),
        (PINHOLE.replace("PinHole", "KannalaBrandt8"), None, "expected no p1 of a KannalaBrandt8"),
        (PINHOLE.replace("Camera1.p2", "#"), None, "Camera1.p2 is missing: expected a number"),
        (FISHEYE.replace("Camera2.k4", "#"), "Camera2", "Camera2.k4 is missing: expected a number"),
        (PINHOLE.replace("640", "wide"), None, "Camera.width is 'wide': expected a number"),
        (PINHOLE + "Camera1.fx: 500.0\n", None, "Camera1.fx is given twice"),
    ],
)
def test_broken_and_ambiguous_settings_get_one_line(
    tmp_path: Path, text: str, name: str | None, message: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises((CameraError, InputFileError)) as caught:
        load_camera(path, name=name)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
