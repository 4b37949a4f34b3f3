"""The two conventions of image coordinates, and the one place where they meet.

In memory (0, 0) is the outer corner of the first pixel, whose centre is at (0.5, 0.5). OpenCV,
camera matrices and COCO keypoints put (0, 0) at that centre.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.floating[Any]]


def image_to_opencv(xy_px: ArrayLike) -> Float:
    """(..., 2) corner-based px to px with centres on whole numbers."""
    return np.asarray(xy_px, np.float64) - 0.5


def opencv_to_image(xy_px: ArrayLike) -> Float:
    """(..., 2) px with centres on whole numbers to corner-based px."""
    return np.asarray(xy_px, np.float64) + 0.5
