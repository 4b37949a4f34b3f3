"""Draw trees on images, and arrange images on pages."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.files.names import printable

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
    """Draw boxes, masks and keypoints on a copy of an image.

    Args:
        image: (H, W, 3) BGR or (H, W) grey, uint8.
        boxes: (N, 4) x0, y0, x1, y1 in continuous px.
        masks: (H, W) arrays, non-zero inside; drawn as outlines. None entries are skipped.
        keypoints: (N, 5, 3) x, y, COCO visibility flag: 2 is drawn as a disc, 1 (hidden) as a ring,
            0 not at all.
        colour: BGR colour of boxes and outlines; by default they have separate colours.
        width_px: Width of the result; image and labels are scaled.
        weight: Factor of line widths and point sizes.

    Returns:
        (H, W, 3) BGR uint8.
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
            centre_px = (int(x * scale), int(y * scale))
            cv2.circle(drawn, centre_px, radius, colour, -1 if flag == 2 else 1, cv2.LINE_AA)


def fitted(image: NDArray[Any], width_px: int, interpolation: int = cv2.INTER_AREA) -> NDArray[Any]:
    """Resize an image to a width with its aspect ratio kept.

    Returns the image itself if it already has that width.
    """
    if image.shape[1] == width_px:
        return image
    height_px = max(1, round(image.shape[0] * width_px / image.shape[1]))
    return np.asarray(cv2.resize(image, (width_px, height_px), interpolation=interpolation))


def with_caption(cell: Picture, text: str) -> Picture:
    """Add a line of text below an image (H, W, 3); text that does not fit is cut off with dots."""
    text = printable(text)
    while len(text) > 4 and cv2.getTextSize(text, _FONT, 0.42, 1)[0][0] > cell.shape[1] - 4:
        text = text[:-4] + "..."
    strip = np.full((CAPTION_PX, cell.shape[1], 3), PAPER, np.uint8)
    cv2.putText(strip, text, (2, CAPTION_PX - 8), _FONT, 0.42, INK, 1, cv2.LINE_AA)
    return np.concatenate([cell, strip])


def grid(cells: Sequence[Picture], columns: int) -> Picture:
    """Arrange images (H, W, 3) of equal width in rows, with gaps."""
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
    """Return a strip (CAPTION_PX, W, 3) with the colour and name of every keypoint."""
    strip = np.full((CAPTION_PX, width_px, 3), PAPER, np.uint8)
    left = 12
    for name, colour in zip(names, KEYPOINT_COLOURS, strict=True):
        cv2.circle(strip, (left, CAPTION_PX // 2), 5, colour, -1, cv2.LINE_AA)
        cv2.putText(strip, name, (left + 10, CAPTION_PX - 8), _FONT, 0.42, INK, 1, cv2.LINE_AA)
        left += 36 + cv2.getTextSize(name, _FONT, 0.42, 1)[0][0]
    return strip
