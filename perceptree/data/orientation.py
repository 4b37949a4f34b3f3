"""Which way up the pictures of a dataset are read, where EXIF says that they are to be turned.

Some labelling programs show the pixels as stored, others turned upright. The size in the label file
tells, for pictures turned by a quarter. For others the pixels are taken as stored.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.files.headers.exif import UPRIGHT
from basetree.files.reading import Picture
from perceptree.data.coco import FrameRecord

ORIENTED = {
    "stored": "pictures with an EXIF orientation are read as stored: so they have the labels' size",
    "turned": "pictures are turned as EXIF says: so they have the labels' size",
}


def as_labelled(picture: Picture, frame: FrameRecord) -> NDArray[Any]:
    """Return a picture's pixels as stored, or turned upright if they have the labels' size so.

    Args:
        picture: The picture.
        frame: Its frame.

    Returns:
        (H, W) or (H, W, channels); as stored if neither has the size.
    """
    if how_labelled(picture, frame) == "turned":
        return np.ascontiguousarray(picture.upright())
    return picture.pixels


def how_labelled(picture: Picture, frame: FrameRecord) -> str:
    """Return how a picture with an EXIF orientation is read.

    Returns:
        A key of `ORIENTED`; empty if the picture states no orientation or has another size.
    """
    if picture.orientation == UPRIGHT:
        return ""
    size = (frame.height, frame.width)
    if picture.pixels.shape[:2] == size:
        return "stored"
    return "turned" if picture.upright().shape[:2] == size else ""
