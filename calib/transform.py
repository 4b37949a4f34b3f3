"""Rigid transforms between coordinate frames, such as camera to camera or camera to machine."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float
from basetree.errors import InputError

_ORTHONORMAL_TOLERANCE = 1e-3
_FARTHEST_M = 1e8  # more than twice around the Earth
_FARTHEST_ON_MACHINE_M = 1000.0
_MOST_TURN_DEG = 360.0
# Columns: right, down and forward of a level camera that looks along the machine's x.
_LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True, eq=False)
class RigidTransform:
    """Transforms points p of one frame to `rotation` p + `translation_m` of another.

    Attributes:
        rotation: (3, 3) rotation matrix. Values may be rounded: a matrix orthonormal to 1e-3 is
            replaced by the nearest rotation.
        translation_m: (3,) origin of the first frame in the second, in metres.

    Raises:
        InputError: If a value has the wrong shape, is not finite, or is not a rotation, or if a
            translation is above 100,000 km.

    Examples:
        >>> from calib import RigidTransform
        >>> mounting = RigidTransform.mounting([1.5, 0.0, 2.2], 0.0, -10.0, 0.0)
        >>> mounting.apply([0.0, 0.0, 5.0]).round(2)  # ahead of the camera, in the machine's frame
        array([6.42, 0.  , 3.07])
    """

    rotation: Float
    translation_m: Float

    def __post_init__(self) -> None:
        rotation = _numbers("rotation", self.rotation, (3, 3))
        deviation = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        if not deviation <= _ORTHONORMAL_TOLERANCE or np.linalg.det(rotation) < 0:
            raise InputError(
                f"rotation is {rotation.tolist()}: expected an orthonormal, right-handed matrix"
            )
        left, _, right = np.linalg.svd(rotation)
        translation_m = _numbers("translation_m", self.translation_m, (3,)).copy()
        if np.abs(translation_m).max() > _FARTHEST_M:
            raise InputError(
                f"translation_m is {translation_m.tolist()}: expected metres, up to {_FARTHEST_M:g}"
            )
        for name, values in (("rotation", left @ right), ("translation_m", translation_m)):
            values.flags.writeable = False
            object.__setattr__(self, name, values)

    @classmethod
    def identity(cls) -> RigidTransform:
        """Return the transform that changes nothing."""
        return cls(np.eye(3), np.zeros(3))

    @classmethod
    def from_quaternion(cls, xyzw: ArrayLike, translation_m: ArrayLike) -> RigidTransform:
        """Create a transform from a quaternion.

        Args:
            xyzw: (4,) quaternion, scalar last, of unit length to within 1e-3.
            translation_m: (3,) metres.

        Raises:
            InputError: If a value is invalid.
        """
        quaternion = _numbers("quaternion_xyzw", xyzw, (4,))
        length = float(np.linalg.norm(quaternion))
        if abs(length - 1) > _ORTHONORMAL_TOLERANCE:
            raise InputError(f"quaternion_xyzw has length {length:g}: expected 1")
        x, y, z, w = quaternion / length
        cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        place_m = _numbers("translation_m", translation_m, (3,))
        return cls(np.eye(3) + 2 * w * cross + 2 * cross @ cross, place_m)

    @classmethod
    def from_euler_deg(
        cls, roll: float, pitch: float, yaw: float, translation_m: ArrayLike
    ) -> RigidTransform:
        """Create a transform from roll, pitch and yaw in degrees.

        The rotations are about the second frame's fixed axes: first x (roll), then y (pitch), then
        z (yaw).

        Args:
            roll: Rotation about x in degrees.
            pitch: Rotation about y in degrees.
            yaw: Rotation about z in degrees.
            translation_m: (3,) metres.

        Raises:
            InputError: If a value is invalid.
        """
        angles_deg = _numbers("roll_pitch_yaw_deg", (roll, pitch, yaw), (3,))
        if np.abs(angles_deg).max() > _MOST_TURN_DEG:
            raise InputError(
                f"roll, pitch and yaw are {angles_deg.tolist()}: expected degrees, from"
                f" {-_MOST_TURN_DEG:g} to {_MOST_TURN_DEG:g}"
            )
        angles = np.radians(angles_deg)
        (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
        about_x = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
        about_y = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
        about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
        return cls(about_z @ about_y @ about_x, _numbers("translation_m", translation_m, (3,)))

    @classmethod
    def mounting(
        cls,
        position_m: ArrayLike,
        roll_deg: float = 0.0,
        pitch_deg: float = 0.0,
        yaw_deg: float = 0.0,
    ) -> RigidTransform:
        """Create the transform from a camera to the machine that carries it.

        Camera: x right, y down, z forward. Machine: x forward, y left, z up. With all angles 0 the
        camera is level and looks forward. The angles are right-handed rotations about the machine's
        axes, in the order of `from_euler_deg`.

        Args:
            position_m: (3,) position of the camera in the machine's frame, in metres; the third
                number is its height above the frame's origin.
            roll_deg: Positive leans the camera to its right.
            pitch_deg: Positive makes the camera look down.
            yaw_deg: Positive makes the camera look to the left.

        Raises:
            InputError: If a value is invalid.
        """
        angles = {"roll_deg": roll_deg, "pitch_deg": pitch_deg, "yaw_deg": yaw_deg}
        roll, pitch, yaw = (float(_numbers(name, angle, ())) for name, angle in angles.items())
        turned = cls.from_euler_deg(roll, pitch, yaw, np.zeros(3))
        return cls(turned.rotation @ _LEVEL, _numbers("position_m", position_m, (3,)))

    def apply(self, points_m: ArrayLike) -> Float:
        """Transform (..., 3) points in metres."""
        return self.rotate(points_m) + self.translation_m

    def rotate(self, directions: ArrayLike) -> Float:
        """Rotate (..., 3) directions."""
        return np.asarray(np.asarray(directions, np.float64) @ self.rotation.T)

    def inverse(self) -> RigidTransform:
        """Return the transform from the second frame to the first."""
        return RigidTransform(self.rotation.T, -self.rotation.T @ self.translation_m)

    def then(self, other: RigidTransform) -> RigidTransform:
        """Return the transform that applies this one first, then `other`."""
        return RigidTransform(other.rotation @ self.rotation, other.apply(self.translation_m))


def check_on_machine(transform: RigidTransform, what: str) -> None:
    """Check the distance between frames of one machine.

    Args:
        transform: Transform between the two.
        what: What messages call it.

    Raises:
        InputError: If they are more than 1000 m apart, as by millimetres.
    """
    if float(np.abs(transform.translation_m).max()) > _FARTHEST_ON_MACHINE_M:
        raise InputError(
            f"{what}: the frames are {transform.translation_m.tolist()} m apart: expected cameras"
            f" and a machine within {_FARTHEST_ON_MACHINE_M:g} m"
        )


def _numbers(name: str, values: ArrayLike, shape: tuple[int, ...]) -> Float:
    """Convert `values` to finite float64 of the given shape; strings and bools are rejected."""
    found = np.asarray(values, object)
    real = all(isinstance(each, Real) and not isinstance(each, bool) for each in found.flat)
    if real and found.shape == shape:
        with suppress(OverflowError):
            array = found.astype(np.float64)
            if np.isfinite(array).all():
                return array
    expected = f"{'x'.join(map(str, shape))} finite numbers" if shape else "a finite number"
    raise InputError(f"{name} is {found.tolist()!r}: expected {expected}")
