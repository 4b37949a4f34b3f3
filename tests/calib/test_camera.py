"""PinholeCamera: validation, scaling, cropping, and camera files."""

import json
import math
from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import numpy as np
import pytest

from basetree.errors import InputFileError
from calib import CameraError, PinholeCamera, load_camera, save_camera
from calib.sizeless import sizeless_camera

CAMERA = PinholeCamera(1280, 720, 700.0, 701.0, 641.5, 355.0, (-0.1, 0.02, 1e-3, -2e-3, 5e-3))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"width": 0}, "image size is 0x720: expected at least 1x1"),
        ({"fx": -700.0}, "fx is -700.0: expected a positive number"),
        ({"fy": math.nan}, "fy is nan: expected a positive number"),
        ({"cx": 1e6}, "cx is 1000000.0: expected a point near the image, 1280 px"),
        ({"cy": math.inf}, "cy is inf: expected a point near the image, 720 px"),
        ({"distortion": [0.1, 0.2]}, "distortion has 2 terms: expected none, 4"),
        ({"distortion": [0.1, math.nan, 0, 0]}, "expected finite numbers"),
        ({"distortion_model": "fov"}, "distortion_model is 'fov': expected radtan or fisheye"),
        ({"distortion_model": "fisheye"}, "distortion has 5 terms: expected 4 (k1 k2 k3 k4)"),
        ({"focal_std_px": -1.0}, "focal_std_px is -1.0: expected 0 or more"),
    ],
)
def test_invalid_cameras_are_rejected(change: dict[str, object], message: str) -> None:
    with pytest.raises(CameraError) as caught:
        PinholeCamera.from_dict({**CAMERA.to_dict(), **change})
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": "700"}, "camera field fx is '700': expected a number"),
        ({"cx": None}, "camera field cx is None: expected a number"),
        ({"height": True}, "camera field height is True: expected a number"),
        ({"width": 12.5}, "camera field width is 12.5: expected whole pixels"),
        ({"distortion": "none"}, "camera field distortion is 'none': expected numbers"),
        ({"distortion": ["a"] * 4}, "camera field distortion is 'a': expected a number"),
        ({"focal_std_px": "1"}, "camera field focal_std_px is '1': expected a number"),
    ],
)
def test_fields_of_the_wrong_type_are_named(change: dict[str, object], message: str) -> None:
    with pytest.raises(CameraError) as caught:
        PinholeCamera.from_dict({**CAMERA.to_dict(), **change})
    assert message in str(caught.value)


def test_a_camera_is_immutable() -> None:
    with pytest.raises(FrozenInstanceError):
        CAMERA.fx = 1.0  # type: ignore[misc]


def test_scaling_maps_image_corners_to_image_corners() -> None:
    half = CAMERA.scaled(640, 360)
    assert (half.width, half.height) == (640, 360)
    assert (half.fx, half.fy) == (350.0, 350.5)
    assert half.cx == 0.5 * (641.5 + 0.5) - 0.5
    assert half.cy == 0.5 * (355.0 + 0.5) - 0.5
    assert half.distortion == CAMERA.distortion
    assert half.scaled(1280, 720) == CAMERA


@pytest.mark.parametrize("size", [(640, 480), (1280, 700), (0, 0), (10, 0)])
def test_another_aspect_ratio_is_rejected(size: tuple[int, int]) -> None:
    with pytest.raises(CameraError, match="expected"):
        CAMERA.scaled(*size)


def test_the_error_names_both_image_sizes() -> None:
    with pytest.raises(CameraError) as caught:
        CAMERA.scaled(640, 480)
    assert "1280x720" in str(caught.value)
    assert "640x480" in str(caught.value)


def test_cropping_moves_the_principal_point() -> None:
    part = CAMERA.cropped(100, 20, 640, 360)
    assert (part.width, part.height, part.cx, part.cy) == (640, 360, 541.5, 335.0)
    assert (part.fx, part.fy, part.distortion) == (CAMERA.fx, CAMERA.fy, CAMERA.distortion)


@pytest.mark.parametrize(
    "part",
    [(-1, 0, 9, 9), (0, -1, 9, 9), (1275, 0, 9, 9), (0, 715, 9, 9), (0, 0, 0, 9), (0, 0, 9, 0)],
)
def test_a_crop_outside_the_image_is_rejected(part: tuple[int, int, int, int]) -> None:
    with pytest.raises(CameraError, match="expected one inside the camera's 1280x720"):
        CAMERA.cropped(*part)


def test_focal_std_scales_with_the_image() -> None:
    assert replace(CAMERA, focal_std_px=3.0).scaled(640, 360).focal_std_px == 1.5


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        replace(CAMERA, distortion=(), focal_std_px=1.25),
        replace(CAMERA, distortion=(0.1,) * 8),
        replace(CAMERA, distortion=(0.1, 0.2, 0.3, 0.4), distortion_model="fisheye"),
    ],
)
def test_a_camera_file_round_trips(tmp_path: Path, camera: PinholeCamera) -> None:
    path = tmp_path / "camera.json"
    save_camera(path, camera)
    assert load_camera(path) == camera
    assert json.loads(path.read_text())["schema"] == "calib.camera/1"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "camera",
    [
        replace(CAMERA, distortion=()),
        replace(CAMERA, focal_std_px=1.25),
        replace(CAMERA, distortion=(0.1, 0.2, 0.3, 0.4), distortion_model="fisheye"),
    ],
)
def test_the_values_of_a_camera_need_no_schema(tmp_path: Path, camera: PinholeCamera) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(camera.to_dict()))
    assert load_camera(path) == camera


def test_distortion_is_optional_without_a_schema(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text('{"width": 640, "height": 480, "fx": 500, "fy": 501, "cx": 320, "cy": 240}')
    assert load_camera(path) == PinholeCamera(640, 480, 500, 501, 320, 240)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"k1": -0.1, "k2": 0.01},
            "the file has k1, k2 and no schema: expected only width, height",
        ),
        ({"schema": "other/1"}, "schema is 'other/1', expected 'calib.camera/1'"),
        ({"width": None}, "camera field width is None: expected a number"),
        ({"distortion": [0.1]}, "distortion has 1 terms: expected none, 4"),
        ({"distortion_model": "plumb_bob"}, "distortion_model is 'plumb_bob': expected radtan"),
    ],
)
def test_values_without_a_schema_are_checked(
    tmp_path: Path, change: dict[str, object], message: str
) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**CAMERA.to_dict(), **change}))
    with pytest.raises(CameraError) as caught:
        load_camera(path)
    assert str(caught.value).startswith(f"{path}: {message}")


def _with(field: str, other: str) -> str:
    """A camera file with another text for one of its fields."""
    values = '"width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240'
    text = f'{{"schema": "calib.camera/1", {values}, "distortion": []}}'
    return text.replace(field, other)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not JSON"),
        ("[1]", "no known camera format, expected one of calib.camera/1, ROS camera_info"),
        ('{"schema": "other/1"}', "schema is 'other/1', expected 'calib.camera/1'"),
        ('{"schema": "calib.camera/1", "width": 3}', "camera field height is None"),
        (_with('"width": 640', '"width": NaN'), "width is nan: expected whole pixels"),
        (_with('"width": 640', '"width": 1e400'), "width is inf: expected whole pixels"),
        (_with('"fx": 500', '"fx": 1' + 400 * "0"), "000: expected a number"),
        (_with("[]", "[0, 0, 0, 1" + 400 * "0" + "]"), "camera field distortion is 1000"),
    ],
)
def test_bad_camera_files_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "camera.json"
    path.write_text(text)
    with pytest.raises((InputFileError, CameraError)) as caught:
        load_camera(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_failed_rename_leaves_the_old_file_unchanged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "camera.json"
    save_camera(path, CAMERA)
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "full")))
    with pytest.raises(InputFileError, match=r"camera\.json: cannot be written \(full\)"):
        save_camera(path, CAMERA.scaled(640, 360))
    assert load_camera(path) == CAMERA
    assert list(tmp_path.iterdir()) == [path]


def test_missing_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputFileError, match=r"nothing\.json: no such file, expected a camera"):
        load_camera(tmp_path / "nothing.json")
    with pytest.raises(InputFileError, match="cannot be read"):
        load_camera(tmp_path)
    with pytest.raises(InputFileError, match="cannot be written"):
        save_camera(tmp_path / "no folder" / "camera.json", CAMERA)
    (tmp_path / "folder").mkdir()
    with pytest.raises(InputFileError, match="cannot be written"):
        save_camera(tmp_path / "folder", CAMERA)
    assert list(tmp_path.iterdir()) == [tmp_path / "folder"]


def test_the_error_of_the_principal_point_goes_with_the_camera() -> None:
    known = replace(CAMERA, principal_std_px=3.0)
    assert known.scaled(640, 360).principal_std_px == 1.5
    assert known.binned(2, 2).principal_std_px == 1.5
    assert PinholeCamera.from_dict(known.to_dict()) == known
    assert "principal_std_px" not in CAMERA.to_dict()
    assert CAMERA.scaled(640, 360).principal_std_px is None
    with pytest.raises(CameraError, match=r"principal_std_px is -1.0: expected 0 or more"):
        replace(CAMERA, principal_std_px=-1.0)


def test_numbers_of_numpy_become_plain_ones() -> None:
    matrix = np.array([[698.4, 0, 639.5], [0, 698.4, 359.5], [0, 0, 1]], np.float32)
    size = np.array([1280, 720])
    camera = PinholeCamera(*size, matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2])
    assert json.loads(json.dumps(camera.to_dict()))["width"] == 1280
    half = camera.scaled(1280 / 2, 720 / 2)
    assert (half.width, type(half.width)) == (640, int)
    with pytest.raises(CameraError, match=r"image size is 640\.5x360: expected whole numbers"):
        camera.scaled(640.5, 360)


def test_a_camera_without_a_size_is_not_written_with_a_guess() -> None:
    camera = sizeless_camera(698.4, 698.4, 650.2, 365.9, (), "radtan")
    for use in (camera.to_dict, lambda: camera.rotated(90)):
        with pytest.raises(CameraError, match=r"expected camera\.scaled\(width, height\)"):
            use()
    assert camera.scaled(1280, 720).to_dict()["fx"] == 698.4
    part = camera.cropped(0, 0, 640, 366)
    assert part.scaled(640, 366) == PinholeCamera(640, 366, 698.4, 698.4, 650.2, 365.9)
    assert camera.binned(2, 2).scaled(640, 360).fx == 349.2
