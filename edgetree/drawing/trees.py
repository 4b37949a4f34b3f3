"""Draw trees on a picture: box, mask, axis, felling cut, diameter and a label for each."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from edgetree.drawing.label_placement import Rect, place_label
from edgetree.drawing.primitives import (
    DARK,
    Colour,
    Picture,
    Point,
    darken,
    draw_dot,
    draw_line,
    text_size,
    write_text,
)

WARNING_SIGN: Final = "!"

# BGR, light enough to be seen on a dark forest, with distinct hues.
_PALETTE: Final[tuple[Colour, ...]] = (
    (80, 175, 255),
    (230, 200, 70),
    (120, 220, 130),
    (200, 130, 255),
    (90, 225, 245),
    (255, 160, 130),
    (150, 150, 255),
    (190, 235, 190),
)
_CUT: Final[Colour] = (60, 60, 255)
_WHITE: Final[Colour] = (255, 255, 255)
_AMBER: Final[Colour] = (60, 190, 255)
_GAP_PX: Final = 6
# Ticks of a profile: smallest distance between two, and largest length as a share of the diameter.
_MIN_TICK_GAP_PX, _TICK_SHARE = 5.0, 0.25
_PICTURE_WEIGHT, _MASK_WEIGHT = 0.68, 0.32


class DrawnTrees(Protocol):
    """What is drawn of `edgetree.detections.TreeDetections`, which draws itself by this module."""

    @property
    def boxes_px(self) -> NDArray[np.float32]:
        """(N, 4) x0, y0, x1, y1."""

    @property
    def scores(self) -> NDArray[np.float32]:
        """(N,) scores."""

    @property
    def keypoints_px(self) -> NDArray[np.float32] | None:
        """(N, 5, 3) x, y, score."""

    @property
    def masks(self) -> NDArray[np.float32] | None:
        """Not None if the trees have masks."""

    def mask(self, index: int) -> NDArray[np.bool_]:
        """(H, W) mask of a tree."""

    def __len__(self) -> int:
        """Number of trees."""


class CutMark(NamedTuple):
    """A measured felling cut: its position in pixels, and the text next to it."""

    xy_px: Point
    text: str


def draw_trees(
    picture: Picture,
    trees: DrawnTrees,
    labels: Sequence[Sequence[str]] | None = None,
    *,
    masks: Sequence[NDArray[np.bool_]] | None = None,
    cuts: Sequence[CutMark | None] | None = None,
    profiles: Sequence[NDArray[np.floating[Any]] | None] | None = None,
    colours: Sequence[Colour] | None = None,
) -> Picture:
    """Draw trees on a copy of a picture.

    Args:
        picture: (H, W, 3) uint8 BGR, of the image size of `trees`.
        trees: The trees; masks and keypoints are drawn if there are any.
        labels: Lines of text for each tree; the scores if None. A line that ends with
            `WARNING_SIGN` is drawn in amber.
        masks: (H, W) bool mask of each tree, to draw instead of the detections' masks.
        cuts: Measured felling cut of each tree; for None, the keypoint is drawn instead.
        profiles: (N, 2, 2) left and right ends of the diameters along each tree in px, at equal
            steps, to mark by ticks at the edges.
        colours: BGR colour of each tree; those of their indices if None.

    Returns:
        (H, W, 3) uint8 BGR. The size of lines and text is proportional to the picture's height.
    """
    canvas = picture.copy()
    inks = [tree_colour(n) for n in range(len(trees))] if colours is None else colours
    scale = max(picture.shape[0] / 720, 0.75)
    far_first = [int(index) for index in np.argsort(trees.boxes_px[:, 3], kind="stable")]
    for index in far_first:
        if masks is not None or trees.masks is not None:
            mask = trees.mask(index) if masks is None else masks[index]
            _draw_mask(canvas, mask, inks[index])
    if profiles is not None:
        for profile in profiles:
            _draw_profile(canvas, profile, scale)
    marks: list[CutMark | None] = list(cuts) if cuts is not None else [None] * len(trees)
    taken: list[Rect] = []
    for index in far_first:
        _draw_box(canvas, trees.boxes_px[index], inks[index], scale)
        if trees.keypoints_px is not None:
            points_px = trees.keypoints_px[index, :, :2]
            taken.append(_draw_keypoints(canvas, points_px, inks[index], scale))
            x, y, _ = trees.keypoints_px[index, 0]
            marks[index] = marks[index] or CutMark((float(x), float(y)), "")
    taken += [_draw_cut(canvas, mark, scale) for mark in marks if mark is not None]
    texts = labels if labels is not None else [[f"{score:.0%}"] for score in trees.scores]
    _draw_labels(canvas, trees, texts, inks, taken, scale)
    return canvas


def picture_of_depth(depth_m: NDArray[np.float32], far_m: float = 20.0) -> Picture:
    """Show depth as colours.

    Args:
        depth_m: (H, W) metres, 0.0 = no reading.
        far_m: Depth of the darkest colour.

    Returns:
        (H, W, 3) uint8 BGR, brighter for smaller depths; black for no reading.
    """
    nearness = np.clip(1.0 - depth_m / far_m, 0.0, 1.0)
    colours = cv2.applyColorMap((32 + nearness * 168).astype(np.uint8), cv2.COLORMAP_BONE)
    colours[depth_m <= 0.0] = 0
    return np.asarray(colours, dtype=np.uint8)


def tree_colour(number: int) -> Colour:
    """The colour, BGR, of a tree with this index or number."""
    return _PALETTE[number % len(_PALETTE)]


def _draw_mask(canvas: Picture, mask: NDArray[np.bool_], colour: Colour) -> None:
    """Tint the pixels of a mask and draw its outline; works only on the mask's bounding box."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return
    box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    inside = mask[box].astype(np.uint8)
    levels = np.arange(256)[:, None] * _PICTURE_WEIGHT + np.array(colour) * _MASK_WEIGHT
    tinted = cv2.LUT(canvas[box], levels.astype(np.uint8)[None])
    cv2.copyTo(tinted, inside, canvas[box])
    outlines, _ = cv2.findContours(
        inside,
        cv2.RETR_EXTERNAL,
        cv2.CHAIN_APPROX_SIMPLE,
        offset=(int(columns[0]), int(rows[0])),
    )
    cv2.drawContours(canvas, outlines, -1, colour, 1, cv2.LINE_AA)


def _draw_box(canvas: Picture, box_px: NDArray[np.float32], colour: Colour, scale: float) -> None:
    """Draw only the corners of the box, which hide less of the tree."""
    x0, y0, x1, y1 = (float(value) for value in box_px)
    reach = min(18 * scale, (x1 - x0) / 3, (y1 - y0) / 3)
    width = max(round(2 * scale), 1)
    for x, dx in ((x0, reach), (x1, -reach)):
        for y, dy in ((y0, reach), (y1, -reach)):
            draw_line(canvas, (x, y), (x + dx, y), colour, width)
            draw_line(canvas, (x, y), (x, y + dy), colour, width)


def _draw_profile(canvas: Picture, ends_px: NDArray[np.floating[Any]] | None, scale: float) -> None:
    """Draw short ticks at both ends of the diameters; only every fifth or tenth of dense ones."""
    if ends_px is None:
        return
    step_px = float(np.median(np.linalg.norm(np.diff(ends_px.mean(1), axis=0), axis=1)))
    every = next((n for n in (1, 5, 10) if n * step_px >= _MIN_TICK_GAP_PX * scale), 50)
    for left, right in ends_px[::every]:
        inwards = (right - left) * min(_TICK_SHARE, 8 * scale / np.linalg.norm(right - left))
        for start, end in ((left, left + inwards), (right - inwards, right)):
            (x0, y0), (x1, y1) = start.tolist(), end.tolist()
            draw_line(canvas, (x0, y0), (x1, y1), _WHITE, 1)


def _draw_keypoints(
    canvas: Picture, points_px: NDArray[np.float32], colour: Colour, scale: float
) -> Rect:
    """Draw the axis and the diameter; returns the area taken by the diameter."""
    cut, left, right, middle, top = ((float(x), float(y)) for x, y in points_px)
    thin, radius = max(round(2 * scale), 1), 3.5 * scale
    for start, end, line_colour in (
        (cut, middle, colour),
        (middle, top, colour),
        (left, right, _WHITE),
    ):
        draw_line(canvas, start, end, DARK, thin + 2)
        draw_line(canvas, start, end, line_colour, thin)
    for point, dot_colour in ((middle, colour), (top, colour), (left, _WHITE), (right, _WHITE)):
        draw_dot(canvas, point, radius + 1.2, DARK)
        draw_dot(canvas, point, radius, dot_colour)
    (x0, x1), (y0, y1) = (sorted((round(a), round(b))) for a, b in zip(left, right, strict=True))
    return _grown((x0, y0, x1, y1), round(5 * scale))


def _draw_cut(canvas: Picture, mark: CutMark, scale: float) -> Rect:
    """Draw a ring at the felling cut, with its text next to it; returns the area taken."""
    for ring, colour in ((8.5, DARK), (7.2, _WHITE), (5.2, _CUT)):
        draw_dot(canvas, mark.xy_px, ring * scale, colour)
    x, y, reach = round(mark.xy_px[0]), round(mark.xy_px[1]), round(10 * scale)
    inside = 0 <= x < canvas.shape[1] and 0 <= y < canvas.shape[0]
    if not (mark.text and inside):
        return x - reach, y - reach, x + reach, y + reach
    pad = round(3 * scale)
    width, height = (side + 2 * pad for side in text_size(mark.text, 0.45 * scale))
    left = x + reach if x + reach + width <= canvas.shape[1] else x - reach - width
    top = round(_within(y - height / 2, 0, max(canvas.shape[0] - height, 0)))
    tag = (left, top, left + width, top + height)
    darken(canvas, tag)
    write_text(canvas, mark.text, (left + pad, tag[3] - pad), 0.45 * scale, _WHITE)
    return min(x - reach, left), min(y - reach, top), max(x + reach, tag[2]), y + reach


def _draw_labels(
    canvas: Picture,
    trees: DrawnTrees,
    texts: Sequence[Sequence[str]],
    inks: Sequence[Colour],
    taken: list[Rect],
    scale: float,
) -> None:
    """Draw the label of each tree next to its diameter, outside the areas already taken."""
    labels: list[tuple[int, Rect, list[str]]] = []
    for index in np.argsort(-trees.boxes_px[:, 3], kind="stable"):
        lines = [text for text in texts[index] if text]
        if lines:
            rect = _place(trees, int(index), _label_size(lines, scale), taken, canvas.shape)
            taken.append(_grown(rect, round(3 * scale)))
            labels.append((int(index), rect, lines))
    for index, rect, _ in labels:
        _draw_leader(canvas, trees.boxes_px[index], rect, inks[index])
    for index, rect, lines in labels:
        _draw_label(canvas, rect, lines, inks[index], scale)


def _grown(rect: Rect, margin_px: int) -> Rect:
    x0, y0, x1, y1 = rect
    return x0 - margin_px, y0 - margin_px, x1 + margin_px, y1 + margin_px


def _label_size(lines: Sequence[str], scale: float) -> tuple[int, int]:
    """Width and height in pixels."""
    width = max(text_size(line, 0.5 * scale)[0] for line in lines)
    pad = round(6 * scale)
    return width + 2 * pad + round(4 * scale), len(lines) * round(19 * scale) + pad


def _draw_label(
    canvas: Picture, rect: Rect, lines: Sequence[str], colour: Colour, scale: float
) -> None:
    darken(canvas, rect)
    x, y, _, bottom = rect
    canvas[y:bottom, x : x + round(4 * scale)] = colour
    for row, line in enumerate(lines, start=1):
        ink = _AMBER if line.endswith(WARNING_SIGN) else _WHITE
        origin = (x + round(10 * scale), y + row * round(19 * scale) - round(4 * scale))
        write_text(canvas, line, origin, 0.5 * scale, ink)


def _draw_leader(canvas: Picture, box_px: NDArray[np.float32], rect: Rect, colour: Colour) -> None:
    """Draw a thin line from the label to the tree's box."""
    x0, y0, x1, y1 = (float(value) for value in box_px)
    start = (_within((x0 + x1) / 2, rect[0], rect[2]), _within((y0 + y1) / 2, rect[1], rect[3]))
    draw_line(canvas, start, (_within(start[0], x0, x1), _within(start[1], y0, y1)), colour, 1)


def _place(
    trees: DrawnTrees,
    index: int,
    size_px: tuple[int, int],
    taken: list[Rect],
    shape: tuple[int, ...],
) -> Rect:
    """The position of a label: at the height of the diameter, or low at the stem if not known."""
    x0, y0, x1, y1 = (float(value) for value in trees.boxes_px[index])
    level = y1 - 0.2 * (y1 - y0)
    if trees.keypoints_px is not None:
        level = float(trees.keypoints_px[index, 1:3, 1].mean())
    level = _within(level, 0, shape[0])
    edges = (x0 - _GAP_PX, x1 + _GAP_PX)
    return place_label(size_px, (*edges, level), taken, trees.boxes_px, (shape[1], shape[0]))


def _within(value: float, lowest: float, highest: float) -> float:
    return min(max(value, lowest), highest)
