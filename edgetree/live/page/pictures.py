"""The picture of the page: trees with their outlines and large numbers, and a blank one."""

from __future__ import annotations

from functools import cache
from typing import Final

import cv2
import numpy as np

from edgetree.drawing import draw_trees
from edgetree.drawing.label_placement import Rect, place_label
from edgetree.drawing.primitives import DARK, Picture
from edgetree.drawing.trees import CutMark, picture_of_depth, tree_colour
from edgetree.live.results import LiveResult
from edgetree.live.tracking.tracks import TreeTrack
from edgetree.measure import Estimate
from edgetree.results.tree_labels import cut_marks

MAX_WIDTH_PX: Final = 1280
_QUALITY: Final = 80
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_GAP_PX: Final = 8
_WHITE: Final = (255, 255, 255)
_GREY: Final = (170, 170, 170)  # trees that are not followed


def draw_result(result: LiveResult) -> Picture:
    """Draw the trees of a result on its image, or on its depth as colours.

    Stems that are followed have a tag with their number and diameter, as in the page's list.

    Returns:
        (H, W, 3) uint8 BGR; black if the frame has neither image nor depth.
    """
    frame, trees = result.frame, result.trees
    picture = frame.image
    if picture is None and frame.depth_m is not None:
        picture = picture_of_depth(frame.depth_m)
    if picture is None:
        picture = np.zeros((trees.image_height, trees.image_width, 3), np.uint8)
    inks = {track.tree: tree_colour(track.number) for track in result.tracks}
    canvas = draw_trees(
        picture,
        trees,
        [()] * len(trees),
        cuts=_cuts(result),
        colours=[inks.get(index, _GREY) for index in range(len(trees))],
    )
    _draw_tags(canvas, result)
    return canvas


def encode_jpeg(picture: Picture) -> bytes:
    """Encode a picture as JPEG, made smaller if it is wider than `MAX_WIDTH_PX`."""
    height, width = picture.shape[:2]
    if width > MAX_WIDTH_PX:
        size = (MAX_WIDTH_PX, round(height * MAX_WIDTH_PX / width))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    return cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1].tobytes()


@cache
def blank_jpeg() -> bytes:
    """A dark picture that says that there is no current one."""
    canvas = np.full((360, 640, 3), 32, np.uint8)
    cv2.putText(canvas, "NO CURRENT PICTURE", (96, 190), _FONT, 1.4, (255, 255, 255), 3)
    return encode_jpeg(canvas)


def _cuts(result: LiveResult) -> list[CutMark | None] | None:
    camera = result.frame.camera
    if result.measurements is None or camera is None:
        return None
    return [mark and mark._replace(text="") for mark in cut_marks(result.measurements, camera)]


def _draw_tags(canvas: Picture, result: LiveResult) -> None:
    """Draw a tag beside each stem that is followed, near ones first."""
    boxes_px, size_px = result.trees.boxes_px, (canvas.shape[1], canvas.shape[0])
    taken: list[Rect] = []
    seen = [(track, track.tree) for track in result.tracks if track.tree is not None]
    for track, index in sorted(seen, key=lambda pair: -float(boxes_px[pair[1], 3])):
        x0, y0, x1, y1 = (float(value) for value in boxes_px[index])
        level_px = min(max(y1 - 0.35 * (y1 - y0), 0.0), canvas.shape[0])
        tag = _Tag(track, canvas.shape[0] / 720)
        edges_px = (x0 - _GAP_PX, x1 + _GAP_PX, level_px)
        taken.append(place_label(tag.size_px, edges_px, taken, boxes_px, size_px))
        tag.draw(canvas, taken[-1])


class _Tag:
    """A stem's number on its colour and its diameter beside it, to be read on a small display."""

    def __init__(self, track: TreeTrack, scale: float) -> None:
        diameter = track.diameter_m
        self._parts = [(f"{track.number}", DARK, tree_colour(track.number))]
        if isinstance(diameter, Estimate):
            self._parts.append((f"{diameter.value * 100:.0f} cm", _WHITE, DARK))
        self._font_scale, self._width = 1.25 * scale, max(round(3 * scale), 1)
        self._pad = max(round(8 * scale), 2)
        sizes = [
            cv2.getTextSize(text, _FONT, self._font_scale, self._width)[0]
            for text, _, _ in self._parts
        ]
        self._widths = [width + 2 * self._pad for width, _ in sizes]
        self.size_px = (sum(self._widths), sizes[0][1] + 2 * self._pad)

    def draw(self, canvas: Picture, rect: Rect) -> None:
        x, top, _, bottom = rect
        for (text, ink, ground), width in zip(self._parts, self._widths, strict=True):
            canvas[top:bottom, x : x + width] = ground
            origin = (x + self._pad, bottom - self._pad)
            cv2.putText(
                canvas, text, origin, _FONT, self._font_scale, ink, self._width, cv2.LINE_AA
            )
            x += width
