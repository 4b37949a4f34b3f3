"""Depth is aligned with the image for all kinds of cameras; unusable depth is reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import calib
from basetree.errors import InputError, InputFileError
from calib.sizeless import sizeless_camera
from edgetree.commands.option_groups import RigOptions
from edgetree.frames.frame import Frame
from edgetree.frames.references import ScaleBar, SizeReferences
from edgetree.frames.rig import Rig, _tell_own

COLOUR = calib.PinholeCamera(64, 48, 50.0, 50.0, 31.5, 23.5)
HALF = COLOUR.scaled(32, 24)


def _wall(path: Path, width: int, height: int, depth_m: float = 2.0) -> Path:
    """Write the depth of a wall with a step."""
    values = np.full((height, width), depth_m, np.float32)
    values[:, : width // 2] *= 1.5
    calib.write_depth(path, values)
    return path


def test_depth_of_the_images_size_is_unchanged(tmp_path: Path) -> None:
    depth_m, fault = Rig().read_depth(_wall(tmp_path / "d.png", 64, 48), Path("a.jpg"), (64, 48))
    assert fault is None
    assert (depth_m[5, 5], depth_m[5, 60]) == (3.0, 2.0)


def test_the_scale_is_metres_per_unit(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 64, 48)
    depth_m, _ = Rig(depth_scale_m=0.0005).read_depth(path)
    assert depth_m[5, 60] == pytest.approx(1.0)


def test_a_calibrated_depth_scale_corrects_the_metres(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 64, 48)
    correction = calib.DepthScale(1.02, -0.05, 0.001, 0.002, -0.9, 0.5, 4.0)
    depth_m, _ = Rig(depth_calibration=correction).read_depth(path)
    assert depth_m[5, 60] == pytest.approx(2.0 * 1.02 - 0.05)


def test_the_scale_option_takes_a_number_or_a_calibration(tmp_path: Path) -> None:
    correction = calib.DepthScale(1.02, -0.05, 0.001, 0.002, -0.9, 0.5, 4.0)
    file = tmp_path / "scale.json"
    calib.save_depth_scale(file, correction)
    options = RigOptions(depth_scale=str(file))
    assert options.rig(None, None).depth_calibration == correction
    assert RigOptions(depth_scale="0.00025").rig(None, None).depth_scale_m == 0.00025
    with pytest.raises(InputFileError, match=r"much: no such file, expected a depth scale"):
        RigOptions(depth_scale="much").rig(None, None)


def test_depth_of_another_camera_is_aligned_with_the_image(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 32, 24)
    rig = Rig(camera=COLOUR, depth_camera=HALF)
    depth_m, _ = rig.read_depth(path, Path("a.jpg"), (64, 48))
    assert depth_m.shape == (48, 64)
    assert (depth_m[24, 8], depth_m[24, 56]) == pytest.approx((3.0, 2.0))
    shift = calib.RigidTransform(np.eye(3), np.array([0.0, 0.0, 0.5]))
    moved = Rig(camera=COLOUR, depth_camera=HALF, depth_extrinsics=shift)
    depth_m, _ = moved.read_depth(path, Path("a.jpg"), (64, 48))
    assert depth_m[24, 56] == pytest.approx(2.5), "0.5 m further from the image's camera"


def test_cameras_of_another_resolution_are_scaled(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 32, 24)
    rig = Rig(camera=COLOUR.scaled(128, 96), depth_camera=COLOUR)
    depth_m, _ = rig.read_depth(path, Path("a.jpg"), (64, 48))
    assert (depth_m[24, 8], depth_m[24, 56]) == pytest.approx((3.0, 2.0))
    assert Rig(camera=COLOUR).camera_for(64, 48) is COLOUR
    assert Rig(camera=COLOUR).camera_for(32, 24) == HALF
    assert Rig().camera_for(32, 24) is None


def test_depth_of_another_size_needs_a_depth_camera(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 32, 24)
    expected = r"d\.png is 32x24 px: expected 64x48 px, like image a\.jpg; pass --depth-camera"
    with pytest.raises(InputError, match=expected):
        Rig(camera=COLOUR).read_depth(path, Path("a.jpg"), (64, 48))


def test_without_a_camera_the_error_does_not_ask_for_a_depth_camera(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 32, 24)
    with pytest.raises(InputError, match=r"expected 64x48 px, like image a\.jpg$"):
        Rig().read_depth(path, Path("a.jpg"), (64, 48))


def test_depth_of_another_aspect_ratio_is_rejected(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 32, 32)
    rig = Rig(camera=COLOUR, depth_camera=HALF)
    expected = r"d\.png is 32x32 px: expected the aspect ratio of --depth-camera, 32x24 px"
    with pytest.raises(calib.CameraError, match=expected):
        rig.read_depth(path, Path("a.jpg"), (64, 48))


def test_implausible_depth_is_reported(tmp_path: Path) -> None:
    path = _wall(tmp_path / "d.png", 64, 48)
    _, fault = Rig(depth_scale_m=1.0).read_depth(path)
    assert fault is not None
    assert "d.png: the median depth is" in fault
    assert "millimetres" in fault


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"depth_camera": HALF}, "--depth-camera given without --camera"),
        (
            {"camera": COLOUR, "depth_extrinsics": calib.RigidTransform.identity()},
            "--depth-extrinsics given without --depth-camera",
        ),
        ({"depth_scale_m": float("nan")}, "--depth-scale is nan: expected metres per unit"),
        ({"depth_scale_m": -0.001}, r"--depth-scale is -0\.001: expected metres per unit"),
    ],
)
def test_contradicting_values_are_rejected(values: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Rig(**values)  # type: ignore[arg-type]


@pytest.mark.parametrize("method", ["vertical_of", "completed"])
def test_a_vertical_that_is_not_used_is_told(caplog: pytest.LogCaptureFixture, method: str) -> None:
    _tell_own.cache_clear()
    image = np.zeros((48, 64, 3), np.uint8)
    frame = Frame("a", None, image, up_camera=np.array([0.0, -1.0, 0.0]))
    rest = (None,) if method == "vertical_of" else (64, 48)
    getattr(Rig(up_camera=(0.0, -2.0, 0.0)), method)(frame, *rest)
    assert not caplog.text
    getattr(Rig(up_camera=(0.0, -1.0, 0.2)), method)(frame, *rest)
    assert "have a vertical, by which they are measured: --up or --pitch is only" in caplog.text


def test_references_that_depth_makes_needless_are_told(caplog: pytest.LogCaptureFixture) -> None:
    _tell_own.cache_clear()
    Rig(references=SizeReferences(horizon_px=(0.0, 20.0, 60.0, 20.0))).tell_depth()
    assert not caplog.text
    bar = ScaleBar((10.0, 10.0, 20.0, 10.0), 0.2)
    Rig(references=SizeReferences(scale_bar=bar)).tell_depth()
    assert "frames of this source have depth, by which they are measured" in caplog.text


def test_a_camera_without_a_size_has_that_of_the_picture() -> None:
    camera = sizeless_camera(400.0, 400.0, 319.5, 239.5, (), "radtan")
    found = Rig(camera=camera).camera_for(640, 480)
    assert found is not None
    assert found.has_size
    assert found.to_dict()["fx"] == 400.0
