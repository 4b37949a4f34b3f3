"""Trees drawn on pictures, and pictures put together to pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.uint8]
Float = NDArray[np.floating[Any]]
Colour = tuple[int, int, int]

# All colours are BGR.
PAPER: Colour = (24, 22, 20)
INK: Colour = (225, 228, 226)
BOX: Colour = (80, 210, 255)
OUTLINE: Colour = (120, 255, 120)
KEYPOINT_COLOURS: tuple[Colour, ...] = (
    (60, 60, 255),
    (255, 200, 40),
    (40, 160, 255),
    (240, 240, 240),
    (255, 120, 220),
)
CAPTION_PX = 24
GAP_PX = 6

_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_trees(
    image: Picture,
    *,
    boxes: Float | None = None,
    masks: Iterable[NDArray[Any] | None] | None = None,
    keypoints: Float | None = None,
    colour: Colour | None = None,
    width_px: int | None = None,
    weight: float = 1.0,
) -> Picture:
    """A copy of a picture (H, W, 3) BGR uint8, or grey (H, W), with trees drawn on it.

    ``boxes`` (N, 4) xyxy px and ``keypoints`` (N, 5, 3) x, y, flag have (0, 0) at the outer corner
    of the first pixel; ``masks`` holds (H, W) arrays, drawn as outlines where they are not 0. A
    keypoint of flag 2 is a disc, of 1 (hidden) a ring, of 0 nothing. ``colour`` is for boxes and
    outlines alike, each its own by default. ``width_px`` scales picture and labels to that width,
    ``weight`` makes lines and points stronger.
    """
    scale = 1.0 if width_px is None else width_px / image.shape[1]
    shown = fitted(image, image.shape[1] if width_px is None else width_px)
    colours = cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR) if shown.ndim == 2 else shown.copy()
    drawn: Picture = np.asarray(colours, np.uint8)
    line = max(1, round(weight * drawn.shape[1] / 900))
    for mask in () if masks is None else masks:
        if mask is not None:
            _draw_outline(drawn, mask, colour or OUTLINE, line)
    for x0, y0, x1, y1 in [] if boxes is None else boxes * scale:
        corners = (round(x0), round(y0)), (round(x1) - 1, round(y1) - 1)
        cv2.rectangle(drawn, *corners, colour or BOX, line)
    for points in [] if keypoints is None else keypoints:
        _draw_keypoints(drawn, points, scale, weight)
    return drawn


def _draw_outline(drawn: Picture, mask: NDArray[Any], colour: Colour, line: int) -> None:
    grey = (mask != 0).astype(np.uint8) * np.uint8(255)
    inside = (fitted(grey, drawn.shape[1]) > 127).astype(np.uint8)
    contours, _ = cv2.findContours(inside, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(drawn, contours, -1, colour, line)


def _draw_keypoints(drawn: Picture, points: Float, scale: float, weight: float) -> None:
    radius = max(2, round(weight * drawn.shape[1] / 250))
    for (x, y, flag), colour in zip(points, KEYPOINT_COLOURS, strict=True):
        if flag > 0:
            place = (int(x * scale), int(y * scale))
            cv2.circle(drawn, place, radius, colour, -1 if flag == 2 else 1, cv2.LINE_AA)


def fitted(image: NDArray[Any], width_px: int, interpolation: int = cv2.INTER_AREA) -> NDArray[Any]:
    """A picture scaled to a width, its aspect kept; the same picture where it has that width."""
    if image.shape[1] == width_px:
        return image
    height_px = max(1, round(image.shape[0] * width_px / image.shape[1]))
    return np.asarray(cv2.resize(image, (width_px, height_px), interpolation=interpolation))


def with_caption(cell: Picture, text: str) -> Picture:
    """A picture (H, W, 3) with a line of text below it; what does not fit ends in dots."""
    while len(text) > 4 and cv2.getTextSize(text, _FONT, 0.42, 1)[0][0] > cell.shape[1] - 4:
        text = text[:-4] + "..."
    strip = np.full((CAPTION_PX, cell.shape[1], 3), PAPER, np.uint8)
    cv2.putText(strip, text, (2, CAPTION_PX - 8), _FONT, 0.42, INK, 1, cv2.LINE_AA)
    return np.concatenate([cell, strip])


def grid(cells: Sequence[Picture], columns: int) -> Picture:
    """Pictures of equal width (H, W, 3) in rows from the left, gaps between them."""
    columns = min(columns, len(cells))
    rows = -(-len(cells) // columns)
    height = max(cell.shape[0] for cell in cells)
    width = cells[0].shape[1]
    sheet = np.full(
        (rows * (height + GAP_PX) + GAP_PX, columns * (width + GAP_PX) + GAP_PX, 3), PAPER, np.uint8
    )
    for number, cell in enumerate(cells):
        top = GAP_PX + number // columns * (height + GAP_PX)
        left = GAP_PX + number % columns * (width + GAP_PX)
        sheet[top : top + cell.shape[0], left : left + width] = cell
    return sheet


def keypoint_legend(names: Sequence[str], width_px: int) -> Picture:
    """A strip (CAPTION_PX, W, 3) with every keypoint's colour and name."""
    strip = np.full((CAPTION_PX, width_px, 3), PAPER, np.uint8)
    left = 12
    for name, colour in zip(names, KEYPOINT_COLOURS, strict=True):
        cv2.circle(strip, (left, CAPTION_PX // 2), 5, colour, -1, cv2.LINE_AA)
        cv2.putText(strip, name, (left + 10, CAPTION_PX - 8), _FONT, 0.42, INK, 1, cv2.LINE_AA)
        left += 36 + cv2.getTextSize(name, _FONT, 0.42, 1)[0][0]
    return strip
