"""Directions in camera coordinates, and the level frame below the camera's heading."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Float

CAMERA_UP = (0.0, -1.0, 0.0)
"""Upward direction of a level camera, in its own coordinates."""

_CAMERA_FORWARD = np.array([0.0, 0.0, 1.0])
# Above this cosine to the vertical, a camera looks straight down and its forward tells no heading.
_STRAIGHT_DOWN = 0.999


def lengths(vectors: Float) -> Float:
    """(...) lengths of (..., K) vectors."""
    return np.asarray(np.sqrt(np.vecdot(vectors, vectors)))


def unit(vectors: Float) -> Float:
    """(..., K) vectors of length 1 in the directions of (..., K) vectors that are not zero."""
    return np.asarray(vectors / lengths(vectors)[..., None])


def cross(a: Float, b: Float) -> Float:
    """(3, ...) cross products of vectors (3, ...)."""
    (ax, ay, az), (bx, by, bz) = a, b
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def heading(up: Float) -> Float:
    """(3,) horizontal direction ahead of a camera, of any length above 0.

    It is that of the optical axis, or of the picture's upper side where the camera looks straight
    down.

    Args:
        up: (3,) unit vector of the vertical in camera coordinates.
    """
    forward = np.array(CAMERA_UP) if abs(up[2]) > _STRAIGHT_DOWN else _CAMERA_FORWARD
    return np.asarray(forward - (forward @ up) * up)


def level_rotation(up: Float) -> Float:
    """(3, 3) rotation from camera coordinates to x ahead, y left and z up, as of `heading`."""
    ahead = unit(heading(up))
    (ux, uy, uz), (ax, ay, az) = up.tolist(), ahead.tolist()
    left = [uy * az - uz * ay, uz * ax - ux * az, ux * ay - uy * ax]
    return np.array([ahead, left, up])
