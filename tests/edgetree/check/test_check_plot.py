"""The plot of a check: dots where they belong, outliers in red."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from edgetree.check import CaliperTable, MeasuredTable, compare, draw_check

Tables = Callable[..., tuple[MeasuredTable, CaliperTable]]


def coloured(picture: NDArray[np.uint8], channel: int) -> NDArray[np.bool_]:
    """Pixels of the plots in which one channel of BGR is much brighter than the others."""
    others = np.delete(picture, channel, axis=2).max(axis=2).astype(int)
    found: NDArray[np.bool_] = picture[..., channel].astype(int) - others > 60
    found[:75] = False  # the words at the top
    return found


def centre_of(mask: NDArray[np.bool_]) -> tuple[float, float]:
    y, x = np.nonzero(mask)
    return float(x.mean()), float(y.mean())


def test_dots_are_at_their_values(tables: Tables) -> None:
    # Both axes of the left panel go from 20 to 40 cm. It is 690 px wide, from x 100 and y 84 on.
    check = compare(*tables([0.21, 0.39, 0.3], [0.21, 0.39, 0.35], [0.002, 0.002, 0.01]))
    picture = draw_check(check.quantities["diameter_m"])
    red, blue = coloured(picture, 2), coloured(picture, 0)
    x, y = centre_of(red[:, :900])
    assert abs(x - (100 + 690 * 0.5)) < 1.5
    assert abs(y - (84 + 690 * 0.25)) < 1.5
    for place in (0.05, 0.95):
        assert blue[round(84 + 690 * (1 - place)), round(100 + 690 * place)]
    assert red[:, 900:].any()


def test_without_outliers_nothing_is_red(tables: Tables) -> None:
    check = compare(*tables([0.2, 0.4], [0.21, 0.4], [0.01, 0.01])).quantities["diameter_m"]
    assert not coloured(draw_check(check), 2).any()


def test_a_single_exact_stem_can_be_drawn(tables: Tables) -> None:
    check = compare(*tables([0.3], [0.3], [1e-9])).quantities["diameter_m"]
    assert coloured(draw_check(check), 0).any()
