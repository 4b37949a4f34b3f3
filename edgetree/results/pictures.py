"""Draw results on frames, and encode the pictures."""

from __future__ import annotations

from typing import Final

import cv2

from basetree.errors import InputError
from edgetree.drawing.primitives import Picture
from edgetree.drawing.trees import draw_trees, picture_of_depth, tree_colour
from edgetree.frames.pipeline import FrameResult
from edgetree.results.tree_labels import cut_marks, numbered, profile_marks, tree_labels

PICTURE_SUFFIXES: Final = (".jpg", ".jpeg", ".png")


def picture_of(result: FrameResult) -> Picture:
    """The image of a frame, or its depth as colours, (H, W, 3) uint8 BGR.

    Raises:
        InputError: The frame has neither.
    """
    frame = result.frame
    if frame.image is not None:
        return frame.image
    if frame.depth_m is None:
        raise InputError(f"frame {frame.name} has neither image nor depth: nothing to draw on")
    return picture_of_depth(frame.depth_m)


def draw_frame(result: FrameResult) -> Picture:
    """Draw a frame's trees with their numbers and measurements.

    Returns:
        (H, W, 3) uint8 BGR: the image, or the depth as colours if there is no image.

    Raises:
        InputError: The frame has neither image nor depth.
    """
    found = result.found
    measurements, camera = result.measurements, result.camera
    cuts, profiles = None, None
    if measurements is not None and camera is not None:
        cuts, profiles = cut_marks(measurements, camera), profile_marks(measurements, camera)
    return draw_trees(
        picture_of(result),
        found.trees,
        numbered(tree_labels(found.trees, measurements), found.names),
        masks=None if found.masks is None else list(found.masks),
        cuts=cuts,
        profiles=profiles,
        colours=None if found.tracks is None else [tree_colour(n or 0) for n in found.tracks],
    )


def encode_picture(picture: Picture, suffix: str) -> bytes:
    """Encode a picture for a file with one of the `PICTURE_SUFFIXES`."""
    quality = [] if suffix == ".png" else [cv2.IMWRITE_JPEG_QUALITY, 92]
    return cv2.imencode(suffix, picture, quality)[1].tobytes()
