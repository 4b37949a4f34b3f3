"""Rigid transforms: composition, inverse, files, mountings."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from basetree.errors import InputError, InputFileError
from calib import RigidTransform, load_transform, save_transform

ROOT_HALF = math.sqrt(0.5)


ANGLES, METRES = st.floats(-180, 180), st.floats(-2, 2)


@st.composite
def transforms(draw: st.DrawFn) -> RigidTransform:
    """Any turn, given as angles or as a quaternion, and a motion of up to 2 m along each axis."""
    move_m = [draw(METRES) for _ in range(3)]
    if draw(st.booleans()):
        return RigidTransform.from_euler_deg(draw(ANGLES), draw(ANGLES), draw(ANGLES), move_m)
    quaternion = np.array([1.0, *(draw(METRES) for _ in range(3))])
    return RigidTransform.from_quaternion(quaternion / np.linalg.norm(quaternion), move_m)


POINTS = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed).normal(size=(6, 3)))


def assert_same(one: RigidTransform, other: RigidTransform) -> None:
    np.testing.assert_allclose(one.rotation, other.rotation, atol=1e-12)
    np.testing.assert_allclose(one.translation_m, other.translation_m, atol=1e-12)


@given(transforms(), POINTS)
def test_a_transform_and_its_inverse_cancel(transform: RigidTransform, points: np.ndarray) -> None:
    same = transform.inverse().apply(transform.apply(points))
    np.testing.assert_allclose(same, points, atol=1e-12)
    assert_same(transform.then(transform.inverse()), RigidTransform.identity())


@given(transforms(), transforms(), POINTS)
def test_then_is_one_after_the_other(
    first: RigidTransform, second: RigidTransform, points: np.ndarray
) -> None:
    both = first.then(second)
    np.testing.assert_allclose(both.apply(points), second.apply(first.apply(points)), atol=1e-12)
    np.testing.assert_allclose(both.rotate(points), second.rotate(first.rotate(points)), atol=1e-12)


@given(transforms(), POINTS)
def test_turns_keep_lengths_and_angles(transform: RigidTransform, points: np.ndarray) -> None:
    turned = transform.rotate(points)
    np.testing.assert_allclose(turned @ turned.T, points @ points.T, atol=1e-12)
    crossed = transform.rotate(np.cross(points[0], points[1]))
    np.testing.assert_allclose(np.cross(turned[0], turned[1]), crossed, atol=1e-12)


def test_quaternions_have_their_scalar_last() -> None:
    about_z = RigidTransform.from_quaternion([0, 0, ROOT_HALF, ROOT_HALF], [5, 0, 0])
    np.testing.assert_allclose(about_z.apply([1, 0, 0]), [5, 1, 0], atol=1e-12)
    np.testing.assert_allclose(about_z.rotate([1, 0, 0]), [0, 1, 0], atol=1e-12)


def test_roll_is_applied_first_and_yaw_last() -> None:
    transform = RigidTransform.from_euler_deg(90, 0, 90, np.zeros(3))
    np.testing.assert_allclose(transform.rotate([0, 1, 0]), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(transform.rotate([0, 0, 1]), [1, 0, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("angles", "camera_direction", "machine_direction"),
    [
        ({}, [0, 0, 1], [1, 0, 0]),
        ({}, [1, 0, 0], [0, -1, 0]),
        ({}, [0, 1, 0], [0, 0, -1]),
        ({"pitch_deg": 90}, [0, 0, 1], [0, 0, -1]),
        ({"yaw_deg": 90}, [0, 0, 1], [0, 1, 0]),
        ({"roll_deg": 90}, [1, 0, 0], [0, 0, -1]),
        ({"roll_deg": 90}, [0, 0, 1], [1, 0, 0]),
    ],
)
def test_a_mounting_gives_the_cameras_directions(
    angles: dict[str, float], camera_direction: list[float], machine_direction: list[float]
) -> None:
    mounting = RigidTransform.mounting([1.0, 0.5, 2.5], **angles)
    np.testing.assert_allclose(mounting.rotate(camera_direction), machine_direction, atol=1e-12)
    assert mounting.apply([0, 0, 0]).tolist() == [1.0, 0.5, 2.5]


@given(transforms())
def test_a_rounded_rotation_becomes_a_true_one(transform: RigidTransform) -> None:
    rounded = np.round(transform.rotation, 4)
    kept = RigidTransform(rounded, np.zeros(3)).rotation
    np.testing.assert_allclose(kept @ kept.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(kept, rounded, atol=2e-4)


@pytest.mark.parametrize(
    ("rotation", "translation", "message"),
    [
        (np.eye(3) * 1.1, [0, 0, 0], "expected an orthonormal, right-handed matrix"),
        (np.diag([1, 1, -1]), [0, 0, 0], "expected an orthonormal, right-handed matrix"),
        (np.eye(2), [0, 0, 0], "expected 3x3 finite numbers"),
        (np.eye(3), [0, 0], "translation_m is [0, 0]: expected 3 finite numbers"),
        (np.eye(3), [0, 0, math.nan], "expected 3 finite numbers"),
        (np.eye(3), ["a", 0, 0], "translation_m is ['a', 0, 0]: expected 3 finite numbers"),
        (np.eye(3), ["1", "2", "3"], "translation_m is ['1', '2', '3']: expected 3 finite"),
        (np.eye(3), [True, 2, 3], "translation_m is [True, 2, 3]: expected 3 finite numbers"),
        (np.eye(3), [10**400, 2, 3], "expected 3 finite numbers"),
        ([[1, 0], [0]], [0, 0, 0], "rotation is [[1, 0], [0]]: expected 3x3 finite numbers"),
    ],
)
def test_invalid_transforms_are_rejected(rotation: Any, translation: Any, message: str) -> None:
    with pytest.raises(InputError) as caught:
        RigidTransform(rotation, translation)
    assert message in str(caught.value)


def test_a_quaternion_of_another_length_is_rejected() -> None:
    with pytest.raises(InputError, match=r"quaternion_xyzw has length 1\.1: expected 1"):
        RigidTransform.from_quaternion([0, 0, 0, 1.1], [0, 0, 0])


@given(transform=transforms())
def test_a_transform_survives_its_file(tmp_path: Path, transform: RigidTransform) -> None:
    path = tmp_path / "depth_to_colour.json"
    save_transform(path, transform)
    assert_same(load_transform(path), transform)
    assert list(tmp_path.iterdir()) == [path]


ZERO = [0.0, 0.0, 0.0]
SIDEWAYS = {"position_m": [1, 0, 2], "yaw_deg": 90}


@pytest.mark.parametrize(
    ("fields", "expected"),
    [
        (
            {"rotation": np.eye(3).tolist(), "translation_m": [1, 2, 3]},
            RigidTransform(np.eye(3), np.array([1, 2, 3])),
        ),
        (
            {"quaternion_xyzw": [0.5, 0.5, 0.5, 0.5], "translation_m": ZERO},
            RigidTransform.from_quaternion([0.5, 0.5, 0.5, 0.5], ZERO),
        ),
        (
            {"roll_pitch_yaw_deg": [10, 20, 30], "translation_m": ZERO},
            RigidTransform.from_euler_deg(10, 20, 30, ZERO),
        ),
        ({"mounting": SIDEWAYS}, RigidTransform.mounting([1, 0, 2], yaw_deg=90)),
    ],
)
def test_a_file_may_use_any_of_the_forms(
    tmp_path: Path, fields: dict[str, Any], expected: RigidTransform
) -> None:
    path = tmp_path / "transform.json"
    path.write_text(json.dumps({"schema": "calib.transform/1", **fields}))
    assert_same(load_transform(path), expected)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"translation_m": ZERO}, "expected translation_m and one of rotation"),
        ({"rotation": np.eye(3).tolist()}, "expected translation_m and one of rotation"),
        (
            {"rotation": np.eye(3).tolist(), "roll_pitch_yaw_deg": ZERO, "translation_m": ZERO},
            "the fields are ['roll_pitch_yaw_deg', 'rotation', 'translation_m']: expected",
        ),
        ({"roll_pitch_yaw_deg": ZERO, "translation_m": ZERO, "unit": "mm"}, "expected"),
        ({"roll_pitch_yaw_deg": 5, "translation_m": ZERO}, "expected three numbers"),
        ({"quaternion_xyzw": [0, 0, 1], "translation_m": ZERO}, "expected 4 finite numbers"),
        ({"mounting": SIDEWAYS, "translation_m": ZERO}, "or mounting alone"),
        ({"mounting": {"yaw_deg": 90}}, "mounting has ['yaw_deg']: expected position_m"),
        ({"mounting": {**SIDEWAYS, "tilt_deg": 4}}, "expected position_m, roll_deg"),
        ({"mounting": [1, 2, 3]}, "mounting has [1, 2, 3]: expected position_m"),
        ({"mounting": {**SIDEWAYS, "yaw_deg": "left"}}, "yaw_deg is 'left': expected a finite"),
        ({"mounting": {"position_m": [True, 2, 3]}}, "position_m is [True, 2, 3]: expected 3"),
        (
            {"roll_pitch_yaw_deg": [0, "5", 0], "translation_m": ZERO},
            "roll_pitch_yaw_deg is [0, '5', 0]: expected 3 finite numbers",
        ),
        ({"quaternion_xyzw": [0, 0, 0, 1], "translation_m": [True, 2, 3]}, "is [True, 2, 3]"),
    ],
)
def test_contradictory_files_are_named(
    tmp_path: Path, fields: dict[str, Any], message: str
) -> None:
    path = tmp_path / "transform.json"
    path.write_text(json.dumps({"schema": "calib.transform/1", **fields}))
    with pytest.raises(InputError) as caught:
        load_transform(path)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"schema": "calib.camera/1"}', "schema is 'calib.camera/1', expected"),
        ("[]", "schema is 'list', expected 'calib.transform/1'"),
        ("{", "not JSON"),
        ('{"schema": "calib.transform/1", "schema": "x"}', "schema is given twice"),
    ],
)
def test_other_files_are_rejected(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "transform.json"
    path.write_text(text)
    with pytest.raises(InputFileError) as caught:
        load_transform(path)
    assert message in str(caught.value)
    with pytest.raises(InputFileError, match="no such file, expected a transform"):
        load_transform(tmp_path / "nothing.json")
