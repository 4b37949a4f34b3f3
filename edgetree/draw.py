"""Trees drawn on their picture: box, mask, axis, felling cut, diameter, and a label each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from edgetree.detections import TreeDetections

__all__ = ["draw_trees", "picture_of_depth"]

Picture: TypeAlias = NDArray[np.uint8]
_Colour: TypeAlias = tuple[int, int, int]
_Rect: TypeAlias = tuple[int, int, int, int]

# BGR, light enough to stand out in a dark forest, far apart in hue.
_PALETTE: Final[tuple[_Colour, ...]] = (
    (80, 175, 255),
    (230, 200, 70),
    (120, 220, 130),
    (200, 130, 255),
    (90, 225, 245),
    (255, 160, 130),
    (150, 150, 255),
    (190, 235, 190),
)
_CUT: Final[_Colour] = (60, 60, 255)
_WHITE: Final[_Colour] = (255, 255, 255)
_DARK: Final[_Colour] = (24, 24, 24)
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_SHIFT: Final = 4  # OpenCV draws with fixed point coordinates of 1/16 px


def draw_trees(
    picture: Picture, trees: TreeDetections, labels: Sequence[Sequence[str]] | None = None
) -> Picture:
    """A copy of the picture with the trees drawn on it.

    Args:
        picture: (H, W, 3) uint8 BGR, of the size that the detections are for.
        trees: what to draw; masks and keypoints where they are there.
        labels: lines of text per tree; the scores if None.

    Returns:
        (H, W, 3) uint8 BGR. Lines and text grow with the picture's height.
    """
    canvas = picture.copy()
    scale = max(picture.shape[0] / 720, 0.75)
    far_first = np.argsort(trees.boxes_px[:, 3], kind="stable")
    for index in far_first:
        _draw_mask(canvas, trees, int(index), _colour(index))
    for index in far_first:
        _draw_box(canvas, trees.boxes_px[index], _colour(index), scale)
        if trees.keypoints_px is not None:
            _draw_keypoints(canvas, trees.keypoints_px[index, :, :2], _colour(index), scale)
    texts = labels if labels is not None else [[f"{score:.0%}"] for score in trees.scores]
    taken: list[_Rect] = []
    for index in reversed(far_first):
        _draw_label(canvas, trees, int(index), texts[index], taken, scale)
    return canvas


def picture_of_depth(depth_m: NDArray[np.float32], far_m: float = 20.0) -> Picture:
    """Depth (H, W) in metres as muted colours, near ones bright; black where it has no reading."""
    nearness = np.clip(1.0 - depth_m / far_m, 0.0, 1.0)
    colours = cv2.applyColorMap((32 + nearness * 168).astype(np.uint8), cv2.COLORMAP_BONE)
    colours[depth_m <= 0.0] = 0
    return np.asarray(colours, dtype=np.uint8)


def _colour(index: int) -> _Colour:
    return _PALETTE[index % len(_PALETTE)]


def _draw_mask(canvas: Picture, trees: TreeDetections, index: int, colour: _Colour) -> None:
    if trees.masks is None:
        return
    mask = trees.mask(index)
    tinted = canvas[mask] * 0.68 + np.array(colour) * 0.32
    canvas[mask] = tinted.astype(np.uint8)
    outlines, _ = cv2.findContours(
        mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
    )
    cv2.drawContours(canvas, outlines, -1, colour, 1, cv2.LINE_AA)


def _draw_box(canvas: Picture, box_px: NDArray[np.float32], colour: _Colour, scale: float) -> None:
    """The four corners of the box: they frame the tree and hide little of it."""
    x0, y0, x1, y1 = (float(value) for value in box_px)
    reach = min(18 * scale, (x1 - x0) / 3, (y1 - y0) / 3)
    width = max(round(2 * scale), 1)
    for x, dx in ((x0, reach), (x1, -reach)):
        for y, dy in ((y0, reach), (y1, -reach)):
            _line(canvas, (x, y), (x + dx, y), colour, width)
            _line(canvas, (x, y), (x, y + dy), colour, width)


def _draw_keypoints(
    canvas: Picture, points_px: NDArray[np.float32], colour: _Colour, scale: float
) -> None:
    """The axis through its three points, the diameter between its two, a ring at the cut."""
    cut, left, right, middle, top = ((float(x), float(y)) for x, y in points_px)
    thin, radius = max(round(2 * scale), 1), 3.5 * scale
    for start, end, line_colour in (
        (cut, middle, colour),
        (middle, top, colour),
        (left, right, _WHITE),
    ):
        _line(canvas, start, end, _DARK, thin + 2)
        _line(canvas, start, end, line_colour, thin)
    for point, dot_colour in ((middle, colour), (top, colour), (left, _WHITE), (right, _WHITE)):
        _dot(canvas, point, radius + 1.2, _DARK)
        _dot(canvas, point, radius, dot_colour)
    for ring, ring_colour in ((8.5, _DARK), (7.2, _WHITE), (5.2, _CUT)):
        _dot(canvas, cut, ring * scale, ring_colour)


def _draw_label(
    canvas: Picture,
    trees: TreeDetections,
    index: int,
    lines: Sequence[str],
    taken: list[_Rect],
    scale: float,
) -> None:
    """A dark plate with the tree's text, beside its diameter, clear of the plates before."""
    lines = [_printable(line) for line in lines if line]
    if not lines:
        return
    font_scale, pad, step = 0.5 * scale, round(6 * scale), round(19 * scale)
    widths = [cv2.getTextSize(line, _FONT, font_scale, 1)[0][0] for line in lines]
    size = (max(widths) + 2 * pad + round(4 * scale), len(lines) * step + pad)
    x, y = _place(trees, index, size, taken, canvas.shape, pad)
    taken.append((x, y, x + size[0], y + size[1]))
    _draw_leader(canvas, trees.boxes_px[index], taken[-1], _colour(index))
    plate = canvas[y : y + size[1], x : x + size[0]]
    plate[:] = (plate * 0.25 + np.array(_DARK) * 0.75).astype(np.uint8)
    plate[:, : round(4 * scale)] = _colour(index)
    for row, line in enumerate(lines):
        origin = (x + pad + round(4 * scale), y + (row + 1) * step - round(pad * 0.7))
        cv2.putText(canvas, line, origin, _FONT, font_scale, _WHITE, 1, cv2.LINE_AA)


def _draw_leader(
    canvas: Picture, box_px: NDArray[np.float32], plate: _Rect, colour: _Colour
) -> None:
    """A thin line by the shortest way from the plate to the box that it belongs to."""
    x0, y0, x1, y1 = (float(value) for value in box_px)
    start = (_within((x0 + x1) / 2, plate[0], plate[2]), _within((y0 + y1) / 2, plate[1], plate[3]))
    _line(canvas, start, (_within(start[0], x0, x1), _within(start[1], y0, y1)), colour, 1)


def _place(
    trees: TreeDetections,
    index: int,
    size: tuple[int, int],
    taken: list[_Rect],
    shape: tuple[int, ...],
    gap: int,
) -> tuple[int, int]:
    """Top left corner for a plate: beside or below the stem, where it hides the least."""
    x0, _, x1, y1 = (float(value) for value in trees.boxes_px[index])
    anchor = y1 - size[1] - gap
    if trees.keypoints_px is not None:
        anchor = float(trees.keypoints_px[index, 1:3, 1].mean()) - size[1] / 2
    best, least = (0, 0), float("inf")
    for rise in range(-6, 11):
        for side, x in enumerate((x1 + gap, x0 - gap - size[0], (x0 + x1 - size[0]) / 2)):
            left = round(_within(x, 0, max(shape[1] - size[0], 0)))
            top = round(_within(anchor - rise * 0.6 * size[1], 0, max(shape[0] - size[1], 0)))
            plate = (left, top, left + size[0], top + size[1])
            hidden = sum(_overlap(plate, other) for other in taken)
            stems = sum(_overlap(plate, tuple(map(int, box))) for box in trees.boxes_px)
            cost = 60 * hidden + 30 * stems + 40 * abs(rise) * size[1] + side
            if cost < least:
                best, least = (left, top), cost
    return best


def _within(value: float, lowest: float, highest: float) -> float:
    return min(max(value, lowest), highest)


def _overlap(a: _Rect, b: tuple[int, ...]) -> int:
    """Pixels that two rectangles share."""
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    return max(width, 0) * max(height, 0)


def _printable(text: str) -> str:
    """OpenCV 4's fonts know only ASCII; from 5 on they have the signs used here."""
    if hasattr(cv2, "FontFace"):
        return text
    return text.replace("±", "+-").replace("Ø", "D")


def _fixed(value_px: float) -> int:
    """From continuous coordinates to OpenCV's fixed point ones, with centres on whole numbers."""
    return round((value_px - 0.5) * 2**_SHIFT)


def _line(
    canvas: Picture,
    start: tuple[float, float],
    end: tuple[float, float],
    colour: _Colour,
    width: int,
) -> None:
    first, second = ((_fixed(x), _fixed(y)) for x, y in (start, end))
    cv2.line(canvas, first, second, colour, width, cv2.LINE_AA, _SHIFT)


def _dot(canvas: Picture, centre: tuple[float, float], radius_px: float, colour: _Colour) -> None:
    place = (_fixed(centre[0]), _fixed(centre[1]))
    cv2.circle(canvas, place, round(radius_px * 2**_SHIFT), colour, -1, cv2.LINE_AA, _SHIFT)
