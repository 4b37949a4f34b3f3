"""Lines, dots and text in continuous pixel coordinates: (0, 0) is the picture's outer corner."""

from __future__ import annotations

from typing import Final, TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.files.names import printable
from edgetree.drawing.label_placement import Rect

Picture: TypeAlias = NDArray[np.uint8]
Colour: TypeAlias = tuple[int, int, int]
Point: TypeAlias = tuple[float, float]

DARK: Final[Colour] = (24, 24, 24)
_FONT: Final = cv2.FONT_HERSHEY_SIMPLEX
_SHIFT: Final = 4  # OpenCV draws with fixed-point coordinates of 1/16 px
_FARTHEST_PX: Final = 1e6  # limit of coordinates, against overflow


def darken(canvas: Picture, rect: Rect) -> None:
    """Darken the part of a rectangle that is inside the picture, as background of text."""
    x0, y0, x1, y1 = (max(value, 0) for value in rect)
    ground = canvas[y0:y1, x0:x1]
    ground[:] = (ground * 0.2 + np.array(DARK) * 0.8).astype(np.uint8)


def write_text(
    canvas: Picture, text: str, origin: tuple[int, int], font_scale: float, ink: Colour
) -> None:
    """Draw one line of text; `origin` is the lower left corner of its first letter."""
    cv2.putText(canvas, _printable(text), origin, _FONT, font_scale, ink, 1, cv2.LINE_AA)


def text_size(text: str, font_scale: float) -> tuple[int, int]:
    """Width and height of a line of text in pixels."""
    width, height = cv2.getTextSize(_printable(text), _FONT, font_scale, 1)[0]
    return width, height


def _printable(text: str) -> str:
    """Replace signs that OpenCV cannot draw; before version 5 its fonts have only ASCII."""
    text = printable(text)
    if hasattr(cv2, "FontFace"):
        return text
    return text.replace("±", "+-").replace("Ø", "D").replace("°", " deg")


def _fixed(value_px: float) -> int:
    """Convert to OpenCV's fixed-point coordinates, with pixel centres at whole numbers."""
    within_px = min(max(value_px, -_FARTHEST_PX), _FARTHEST_PX)
    return round((within_px - 0.5) * 2**_SHIFT)


def draw_line(
    canvas: Picture,
    start: Point,
    end: Point,
    colour: Colour,
    width: int,
) -> None:
    """Draw an antialiased line, `width` pixels wide."""
    first, second = ((_fixed(x), _fixed(y)) for x, y in (start, end))
    cv2.line(canvas, first, second, colour, width, cv2.LINE_AA, _SHIFT)


def draw_dot(canvas: Picture, centre: Point, radius_px: float, colour: Colour) -> None:
    """Draw an antialiased filled circle."""
    fixed_centre = (_fixed(centre[0]), _fixed(centre[1]))
    cv2.circle(canvas, fixed_centre, round(radius_px * 2**_SHIFT), colour, -1, cv2.LINE_AA, _SHIFT)
