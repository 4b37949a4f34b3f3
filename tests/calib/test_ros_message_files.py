"""Dumps of ROS's CameraInfo messages."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputFileError
from calib import CameraError, PinholeCamera, load_camera, project_points

K = [923.28076171875, 0.0, 636.6947631835938, 0.0, 923.6041870117188, 376.4419860839844, 0, 0, 1.0]
PLUMB_BOB = [0.158, -0.4896, -0.00111, 0.00064, 0.4378]
RATIONAL = [0.56, -2.71, 2.1e-4, -1.4e-4, 1.53, 0.44, -2.53, 1.46]
EQUIDISTANT = [-0.0346, -0.0099, 0.0072, -0.0024]
POINTS_M = np.array([[x, y, 1.0] for x in np.linspace(-0.6, 0.6, 7) for y in (-0.35, 0, 0.35)])


def listed(values: list[float]) -> str:
    return "".join(f"\n- {value}" for value in values) if values else " []"


def ros2(
    terms: list[float],
    model: str = "plumb_bob",
    frame: str = "camera_color_optical_frame",
    sec: int = 1718500617,
    region: tuple[int, int] = (0, 0),
) -> str:
    """A message as ``ros2 topic echo`` prints it."""
    return f"""\
header:
  stamp:
    sec: {sec}
    nanosec: 444867328
  frame_id: {frame}
height: 720
width: 1280
distortion_model: {model}
d:{listed(terms)}
k:{listed(K)}
r:{listed([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])}
p:{listed([900.0, 0.0, 640.0, 0.0, 0.0, 900.0, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0])}
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: {region[1]}
  width: {region[0]}
  do_rectify: false
---
"""


def ros1(terms: list[float]) -> str:
    """A message as ``rostopic echo`` prints it."""
    return f"""\
header:
  seq: 1009
  stamp:
    secs: 1616939816
    nsecs:  37440538
  frame_id: "camera_color_optical_frame"
height: 720
width: 1280
distortion_model: "plumb_bob"
D: {terms}
K: {K}
R: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
P: [900.0, 0.0, 640.0, 0.0, 0.0, 900.0, 360.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi:
  x_offset: 0
  y_offset: 0
  height: 0
  width: 0
  do_rectify: False
---
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "camera_info.yaml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("text", "terms", "fisheye"),
    [
        (ros2(PLUMB_BOB), PLUMB_BOB, False),
        (ros1(PLUMB_BOB), PLUMB_BOB, False),
        (ros2(RATIONAL, "rational_polynomial"), RATIONAL, False),
        (ros2(EQUIDISTANT, "equidistant"), EQUIDISTANT, True),
        (ros2([], "''"), [], False),
        (ros2([0.0] * 5, region=(1280, 720)), [], False),
    ],
)
def test_a_message_is_the_camera_of_the_raw_image(
    tmp_path: Path, text: str, terms: list[float], fisheye: bool
) -> None:
    camera = load_camera(write(tmp_path, text))
    model = "fisheye" if fisheye else "radtan"
    assert camera == PinholeCamera(1280, 720, K[0], K[4], K[2], K[5], tuple(terms), model)
    project = cv2.fisheye.projectPoints if fisheye else cv2.projectPoints
    lens = np.array(terms or [0.0] * 5)
    pixels = project(POINTS_M[:, None], np.zeros(3), np.zeros(3), np.reshape(K, (3, 3)), lens)[0]
    np.testing.assert_allclose(
        project_points(camera, POINTS_M) - 0.5, pixels.reshape(-1, 2), atol=1e-6
    )


def test_repeated_messages_are_one_camera(tmp_path: Path) -> None:
    text = ros2(PLUMB_BOB) + ros2(PLUMB_BOB, sec=1718500618)
    camera = load_camera(write(tmp_path, text))
    assert camera.distortion == tuple(PLUMB_BOB)
    assert load_camera(write(tmp_path, text), name="camera_color_optical_frame") == camera


def test_a_dump_of_two_cameras_asks_for_a_name(tmp_path: Path) -> None:
    path = write(tmp_path, ros2(PLUMB_BOB) + ros2([0.0] * 5, frame="camera_depth_optical_frame"))
    with pytest.raises(
        InputFileError,
        match="2 cameras, expected one of the names 'camera_color_optical_frame', 'camera_depth",
    ):
        load_camera(path)
    assert load_camera(path, name="camera_depth_optical_frame").distortion == ()


def test_two_frames_of_equal_values_keep_their_names(tmp_path: Path) -> None:
    path = write(tmp_path, ros2(PLUMB_BOB, frame="infra1") + ros2(PLUMB_BOB, frame="infra2"))
    assert load_camera(path, name="infra1") == load_camera(path, name="infra2")


def test_other_values_of_the_same_frame_are_another_camera(tmp_path: Path) -> None:
    path = write(tmp_path, ros2(PLUMB_BOB) + ros2(RATIONAL, "rational_polynomial"))
    with pytest.raises(InputFileError, match="'camera_color_optical_frame 2'"):
        load_camera(path)
    camera = load_camera(path, name="camera_color_optical_frame 2")
    assert camera.distortion == tuple(RATIONAL)


def test_messages_in_json_are_chosen_by_their_key(tmp_path: Path) -> None:
    message = {"width": 1280, "height": 720, "distortion_model": "plumb_bob", "K": K}
    text = json.dumps({"color": {**message, "D": PLUMB_BOB}, "depth": {**message, "D": []}})
    assert load_camera(write(tmp_path, text), name="color").distortion == tuple(PLUMB_BOB)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (ros2(PLUMB_BOB, "brown"), "distortion_model is 'brown': expected plumb_bob, rational"),
        (ros2(PLUMB_BOB, "''"), "distortion_model is '': expected plumb_bob"),
        (
            ros2(PLUMB_BOB, region=(1281, 360)),
            "the crop is 1281x360 px at (0, 0): expected one inside the camera's 1280x720",
        ),
        (
            ros1(PLUMB_BOB).replace(str(K), str([0.0] * 9)).replace("P:", "Q:"),
            "K is all 0, ROS's mark of an uncali",
        ),
        (ros1(PLUMB_BOB).replace("height: 720\n", ""), "height is missing: expected a number"),
        (ros1(PLUMB_BOB).replace("D:", "d: [0]\nD:"), "d and D are both given"),
        (ros1(PLUMB_BOB).replace("D:", "E:"), "d or D is missing"),
        (ros2(PLUMB_BOB) + "a: 1\n", "no known camera format"),
    ],
)
def test_broken_messages_get_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = write(tmp_path, text)
    with pytest.raises((CameraError, InputFileError)) as caught:
        load_camera(path)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
