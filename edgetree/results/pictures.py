"""Draw results on frames and write them as picture files."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import cv2

from basetree.errors import InputError
from basetree.files.writing import replacing
from edgetree.drawing.primitives import Picture
from edgetree.drawing.trees import draw_trees, picture_of_depth
from edgetree.frames.pipeline import FrameResult
from edgetree.results.tree_labels import cut_marks, numbered, profile_marks, tree_labels

__all__ = [
    "PICTURE_SUFFIXES",
    "draw_frame",
    "encode_picture",
    "write_picture",
]

PICTURE_SUFFIXES: Final = (".jpg", ".jpeg", ".png")


def draw_frame(result: FrameResult) -> Picture:
    """Draw a frame's trees with their numbers and measurements.

    Returns:
        (H, W, 3) uint8 BGR: the image, or the depth as colours if there is no image.

    Raises:
        InputError: the frame has neither image nor depth.
    """
    frame, found = result.frame, result.found
    picture = frame.image
    if picture is None and frame.depth_m is not None:
        picture = picture_of_depth(frame.depth_m)
    if picture is None:
        raise InputError(f"frame {frame.name} has neither image nor depth: nothing to draw on")
    measurements, camera = result.measurements, result.camera
    cuts, profiles = None, None
    if measurements is not None and camera is not None:
        cuts, profiles = cut_marks(measurements, camera), profile_marks(measurements, camera)
    return draw_trees(
        picture,
        found.trees,
        numbered(tree_labels(found.trees, measurements), found.numbers),
        masks=None if found.masks is None else list(found.masks),
        cuts=cuts,
        profiles=profiles,
    )


def encode_picture(picture: Picture, suffix: str) -> bytes:
    """Encode a picture for a file with one of the `PICTURE_SUFFIXES`."""
    quality = [] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 92]
    return cv2.imencode(suffix, picture, quality)[1].tobytes()


def write_picture(folder: Path, result: FrameResult) -> Path:
    """Draw a frame and write it to `folder`.

    Returns:
        The path of the file, `<frame name>_trees.jpg`.

    Raises:
        InputError: the file cannot be written.
    """
    path = folder / f"{result.frame.name}_trees.jpg"
    data = encode_picture(draw_frame(result), path.suffix)
    with replacing(path) as file:
        file.write(data)
    return path
