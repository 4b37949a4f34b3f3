"""Captions that camera traps and other cameras print on pictures: date, temperature, logo."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from basetree.arrays import UInt8

_Colour = tuple[int, int, int]

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_CAP_PX = 21.0  # height of capital letters at scale 1, px
_LEAST_PX = 7  # smallest height of a strip, px
_WHITE, _BLACK, _YELLOW = (255, 255, 255), (0, 0, 0), (40, 230, 250)
_MAKERS = ("TRAIL", "WILDCAM", "FOREST EYE", "SPYPOINT X", "HC", "NORD")


def draw_caption(rng: np.random.Generator, image: UInt8) -> UInt8:
    """Print a caption: two thin strips, one thick strip with a logo, or text alone.

    Args:
        rng: Source of random numbers.
        image: (H, W, 3) uint8 BGR.

    Returns:
        A changed copy of `image`.
    """
    marked = image.copy()
    (_two_strips, _one_strip, _text_alone)[rng.choice(3, p=(0.4, 0.4, 0.2))](rng, marked)
    return marked


def _two_strips(rng: np.random.Generator, image: UInt8) -> None:
    """Thin strips at the top and the bottom: date, time, count, moon, degrees; name and logo."""
    height, width = image.shape[:2]
    thick = max(_LEAST_PX, round(height * rng.uniform(0.018, 0.032)))
    image[:thick], image[height - thick :] = 0, 0
    _write(image, f"{_date(rng)} {_time(rng)}  M {rng.integers(1, 11)}/10", 0.02, 0, thick)
    _moon(rng, image, int(0.88 * width), thick // 2, thick, _WHITE)
    _write(image, _degrees(rng), 0.92, 0, thick)
    low = height - thick
    _write(image, f"{_MAKERS[rng.integers(len(_MAKERS))]}{rng.integers(400)}", 0.02, low, thick)
    _logo(rng, image, int(0.9 * width), height - int(0.5 * thick), thick)


def _one_strip(rng: np.random.Generator, image: UInt8) -> None:
    """A strip at the bottom, or the top, with a logo that is often taller than the strip."""
    height, width = image.shape[:2]
    thick = max(_LEAST_PX, round(height * rng.uniform(0.03, 0.075)))
    top = height - thick if rng.random() < 0.85 else 0
    paper, ink = (_WHITE, _BLACK) if rng.random() < 0.5 else (_BLACK, _WHITE)
    image[top : top + thick] = paper
    start = 0.02
    if rng.random() < 0.6:
        tall = round(thick * rng.uniform(1.0, 1.9))
        wide, first = round(1.1 * tall), top + thick - tall if top else 0
        image[first : first + tall, :wide] = rng.integers(0, 256, 3)
        cv2.circle(image, (wide // 2, first + tall // 3), max(1, tall // 5), _BLACK, -1)
        start = (wide + 6) / width
    name = f"{_MAKERS[rng.integers(len(_MAKERS))]}{rng.integers(40)}"
    _write(image, f"{name}  {_degrees(rng)}", start, top, thick, ink)
    _moon(rng, image, int(0.5 * width), top + thick // 2, thick, ink)
    _write(image, f"{_date(rng)} {_time(rng)}", rng.uniform(0.58, 0.68), top, thick, ink)


def _text_alone(rng: np.random.Generator, image: UInt8) -> None:
    """Date and time over the picture in a corner."""
    height = image.shape[0]
    thick = max(_LEAST_PX, round(height * rng.uniform(0.03, 0.06)))
    top = int(rng.choice([0.01, 0.93]) * height)
    ink = _WHITE if rng.random() < 0.6 else _YELLOW
    _write(image, f"{_date(rng)} {_time(rng)}", float(rng.choice([0.02, 0.6])), top, thick, ink)


def _write(
    image: UInt8, text: str, start: float, top: int, thick: int, ink: _Colour = _WHITE
) -> None:
    """Write a line from `start`, a fraction of the width, into the rows of a strip."""
    scale, stroke = 0.62 * thick / _CAP_PX, max(1, round(thick / 16))
    foot = (int(start * image.shape[1]), top + round(0.81 * thick))
    cv2.putText(image, text, foot, _FONT, scale, ink, stroke, cv2.LINE_AA)


def _moon(rng: np.random.Generator, image: UInt8, x: int, y: int, thick: int, ink: _Colour) -> None:
    """A disc or ring for the moon's phase."""
    filled = -1 if rng.random() < 0.5 else 1
    cv2.circle(image, (x, y), max(1, int(0.3 * thick)), ink, filled, cv2.LINE_AA)


def _logo(rng: np.random.Generator, image: UInt8, x: int, y: int, thick: int) -> None:
    """A coloured oval with a dark rim."""
    axes = (int(2.6 * thick), int(0.8 * thick))
    colour = tuple(int(value) for value in rng.integers(0, 200, 3))
    cv2.ellipse(image, (x, y), axes, 0, 0, 360, colour, -1, cv2.LINE_AA)
    cv2.ellipse(image, (x, y), axes, 0, 0, 360, _BLACK, 1, cv2.LINE_AA)
    _write(image, "CAM", (x - axes[0] / 2) / image.shape[1], y - thick // 2, thick)


def _date(rng: np.random.Generator) -> str:
    year, month, day = rng.integers(2008, 2027), rng.integers(1, 13), rng.integers(1, 29)
    styles: tuple[Any, ...] = (
        f"{year}-{month:02d}-{day:02d}",
        f"{month:02d}-{day:02d}-{year}",
        f"{day:02d}.{month:02d}.{year}",
        f"{month:02d}/{day:02d}/{year}",
    )
    return str(styles[rng.integers(len(styles))])


def _time(rng: np.random.Generator) -> str:
    hour, minute, second = rng.integers(24), rng.integers(60), rng.integers(60)
    if rng.random() < 0.5:
        return f"{hour:02d}:{minute:02d}:{second:02d}"
    return f"{hour % 12 or 12}:{minute:02d}:{second:02d} {'AM' if hour < 12 else 'PM'}"


def _degrees(rng: np.random.Generator) -> str:
    celsius = int(rng.integers(-15, 32))
    return (f"{celsius}C", f"{round(1.8 * celsius + 32)}F")[int(rng.random() < 0.4)]
