"""Convert between the two conventions of image coordinates.

Continuous px, used throughout this project: (0, 0) is the outer corner of the first pixel, whose
centre is (0.5, 0.5). OpenCV's px, also used by camera matrices and COCO keypoints: (0, 0) is the
first pixel's centre.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float


def image_to_opencv(xy_px: ArrayLike) -> Float:
    """Convert (..., 2) continuous px to OpenCV's px.

    Examples:
        >>> image_to_opencv([[0.5, 0.5]])  # the centre of the first pixel
        array([[0., 0.]])
    """
    return np.asarray(xy_px, np.float64) - 0.5


def opencv_to_image(xy_px: ArrayLike) -> Float:
    """Convert (..., 2) OpenCV's px to continuous px."""
    return np.asarray(xy_px, np.float64) + 0.5
