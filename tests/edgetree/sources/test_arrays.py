"""Frames from driver arrays: units, colour order, sizes and types."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import calib
from basetree.errors import InputError
from edgetree.sources.arrays import frame_from_arrays

CAMERA = calib.PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)


def picture() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (48, 64, 3), np.uint8)


def metres() -> np.ndarray:
    return np.tile(np.linspace(2, 6, 64, dtype=np.float32), (48, 1))


def frame(image: Any = None, depth: Any = None, **values: Any) -> Any:
    return frame_from_arrays(0, 1.5, picture() if image is None else image, depth, **values)


def test_what_is_given_comes_back() -> None:
    pose = calib.RigidTransform(np.eye(3), (1, 2, 3))
    live = frame_from_arrays(
        7, 1.5, picture(), metres(), camera=CAMERA, up_camera=(0, -2, 0), pose=pose
    )
    assert (live.number, live.time_s, live.camera, live.pose) == (7, 1.5, CAMERA, pose)
    np.testing.assert_array_equal(live.image, picture())
    np.testing.assert_array_equal(live.depth_m, metres())
    np.testing.assert_array_equal(live.up_camera, [0, -1, 0])
    assert live.depth_fault is None


def test_arrays_are_copied_as_drivers_use_their_buffers_again() -> None:
    image, depth = picture(), metres()
    live = frame(image, depth)
    image[:], depth[:] = 0, 0
    np.testing.assert_array_equal(live.image, picture())
    np.testing.assert_array_equal(live.depth_m, metres())


def test_colour_order_and_alpha() -> None:
    rgb = picture()[..., ::-1]
    np.testing.assert_array_equal(frame(rgb, colour_order="rgb").image, picture())
    rgba = np.dstack([rgb, rgb[..., 0]])
    np.testing.assert_array_equal(frame(rgba, colour_order="rgb").image, picture())
    bgra = np.dstack([picture(), rgb[..., 0]])
    np.testing.assert_array_equal(frame(bgra).image, picture())
    grey = frame(picture()[..., 0]).image
    np.testing.assert_array_equal(grey, picture()[..., :1].repeat(3, axis=2))


def test_16_bit_depth_has_a_scale() -> None:
    steps = np.rint(metres() * 1000).astype(np.uint16)
    np.testing.assert_array_equal(frame(depth=steps).depth_m, steps / np.float32(1000))
    quarter = frame(depth=(4 * steps).astype(np.uint16), depth_scale_m=0.00025).depth_m
    np.testing.assert_allclose(quarter, steps / 1000, rtol=1e-6)


def test_float_depth_in_millimetres_is_refused_by_name() -> None:
    expected = r"depth of frame 0 is floating point .* looks like millimetres: divide by 1000"
    with pytest.raises(InputError, match=expected):
        frame(depth=metres() * 1000)
    scaled = frame(depth=metres().astype(np.float64) * 1000, depth_scale_m=0.001).depth_m
    np.testing.assert_allclose(scaled, metres(), rtol=1e-6)


def test_missing_readings_become_0_and_few_of_them_a_fault() -> None:
    depth = metres()
    depth[:, :3] = np.nan, np.inf, -1
    live = frame(depth=depth)
    assert not live.depth_m[:, :3].any()
    assert live.depth_fault is None
    empty = frame(depth=np.zeros((48, 64), np.uint16))
    assert "no pixel has depth" in empty.depth_fault


def test_the_camera_is_scaled_to_the_image() -> None:
    large = CAMERA.scaled(128, 96)
    assert frame(camera=large).camera == CAMERA
    with pytest.raises(calib.CameraError, match="same aspect ratio"):
        frame(camera=CAMERA.scaled(128, 96).cropped(0, 0, 128, 48))


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ({"image": picture().astype(np.float32)}, r"has shape \(48, 64, 3\) of float32: expected"),
        ({"image": picture()[..., :2]}, r"has shape \(48, 64, 2\) of uint8"),
        ({"colour_order": "gbr"}, "colour_order is 'gbr': expected 'bgr' or 'rgb'"),
        ({"depth": np.zeros((24, 32), np.uint16)}, "is 32x24 px: expected 64x48 px, like its"),
        ({"depth": np.zeros((48, 64), np.uint8)}, "holds integers of 8 bits, whose unit"),
        ({"depth": np.zeros((48, 64), bool)}, "of bool: expected"),
        ({"depth": np.zeros((48, 64), complex)}, "of complex128: expected"),
        ({"depth": metres(), "depth_scale_m": 1e300}, "depth_scale_m is 1e.300: expected"),
        ({"depth": metres(), "depth_kind": "radius"}, "depth_kind is radius: expected depth"),
        ({"depth": metres(), "depth_kind": "range"}, "is a range along the rays: expected the"),
        ({"depth": metres(), "depth_scale_m": 0}, "depth_scale_m is 0: expected"),
        ({"depth": metres(), "depth_scale_m": -1.0}, "depth_scale_m is -1.0: expected"),
        ({"up_camera": (0, 0, 0)}, "up_camera is .* not all 0"),
        ({"up_camera": (0, np.nan, 0)}, "up_camera is"),
    ],
)
def test_what_cannot_be_used_is_named(values: dict[str, Any], expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        frame(**values)


def test_a_frame_needs_pictures_and_a_time() -> None:
    with pytest.raises(InputError, match="frame 3 has neither image nor depth"):
        frame_from_arrays(3, 0.0, None)
    with pytest.raises(InputError, match="time_s of frame_000003 is nan: expected seconds"):
        frame_from_arrays(3, float("nan"), picture())
    assert frame_from_arrays(0, 0.0, None, metres()).image is None
