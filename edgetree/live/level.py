"""Level directions of a camera."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["level_axes"]

_LEAST_LEVEL_PART = 0.1


def level_axes(up_camera: NDArray[np.floating[Any]] | None) -> NDArray[np.float64]:
    """Unit vectors to the right, ahead and up, in the camera's frame.

    Args:
        up_camera: (3,) unit vector away from gravity in the camera's frame; None if level.

    Returns:
        (3, 3), one direction in each row. For a camera that looks straight up or down, ahead is the
        top of the image.
    """
    up = np.array([0.0, -1.0, 0.0]) if up_camera is None else np.asarray(up_camera, np.float64)
    forward, image_up = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    ahead = forward - (forward @ up) * up
    if np.linalg.norm(ahead) < _LEAST_LEVEL_PART:
        ahead = image_up - (image_up @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), ahead, up])
