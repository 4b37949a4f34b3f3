"""Diameters along one stem in the report: a chart, the taper and the volume of the seen part."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from edgetree.measure import Estimate, StemProfile, TreeMeasurement
from edgetree.measure.volume import VOLUME_SOURCE
from edgetree.report.charts import nice_axis
from edgetree.report.units import CLASS_EDGE, PROFILE_HEIGHT, length_attributes, unit_name
from edgetree.results.units import AMOUNTS

__all__ = ["further_values_html"]

_LEFT, _TOP, _PLOT_WIDTH, _PLOT_HEIGHT = 38, 24, 214, 150
_WIDTH, _HEIGHT = _LEFT + _PLOT_WIDTH + 18, _TOP + _PLOT_HEIGHT + 34
_STDS: Final = 1.96
_MAX_LEVELS: Final = 8
_HEIGHTS_FROM: Final = {"ground": "above the ground", "section": "above the section"}


def further_values_html(tree: TreeMeasurement) -> Iterator[str]:
    """The values that have no column; those along the stem are folded until a click."""
    if not tree.distance_m and (distance := _value(tree, "axis_distance_m")):
        yield f"distance to the axis {distance}"
    if volume := _value(tree, "volume_m3"):
        yield f"stem volume {volume} ({tree.species}, {VOLUME_SOURCE})"
    if isinstance(tree.profile, StemProfile):
        parts = (("taper", "taper_cm_per_m"), ("volume of the seen part", "seen_volume_m3"))
        words = (
            f"<div>{what} {text}</div>" for what, name in parts if (text := _value(tree, name))
        )
        yield (
            f"<details><summary>profile of {len(tree.profile.height_m)} diameters</summary>"
            f"{''.join(words)}{_chart(tree.profile)}</details>"
        )


def _value(tree: TreeMeasurement, quantity: str) -> str:
    """A value with its ±, for the script to convert; empty if there is none."""
    result = getattr(tree, quantity)
    if not isinstance(result, Estimate):
        return ""
    text = AMOUNTS[quantity].with_std(result)
    return f"<span {length_attributes(quantity, result)}>{text}</span>"


def _chart(profile: StemProfile) -> str:
    """The diameters over the height as SVG, with their 95 % intervals."""
    diameter_cm, spread_cm = 100 * profile.diameter_m, 100 * _STDS * profile.diameter_std_m
    heights_m: list[float] = profile.height_m.tolist()
    end_cm, step_cm = nice_axis(float((diameter_cm + spread_cm).max()))
    lowest_m = min(0, math.floor(heights_m[0]))
    highest_m = max(math.ceil(heights_m[-1]), lowest_m + 1)

    def x(value_cm: float) -> float:
        return _LEFT + _PLOT_WIDTH * value_cm / end_cm

    def y(value_m: float) -> float:
        return _TOP + _PLOT_HEIGHT * (highest_m - value_m) / (highest_m - lowest_m)

    def path(values_cm: list[float], heights_m: list[float]) -> str:
        points = zip(values_cm, heights_m, strict=True)
        return "L".join(f"{x(value):.1f} {y(height):.1f}" for value, height in points)

    low_cm, high_cm = (diameter_cm - spread_cm).tolist(), (diameter_cm + spread_cm).tolist()
    band = path(low_cm + high_cm[::-1], heights_m + heights_m[::-1])
    levels = "".join(
        f'<path class="axis" d="M{_LEFT} {y(level):.1f}H{_LEFT + _PLOT_WIDTH}"/>'
        f'<text x="{_LEFT - 6}" y="{y(level) + 4:.1f}" text-anchor="end">'
        f"{_tick(PROFILE_HEIGHT, level, f'{level}')}</text>"
        for level in range(lowest_m, highest_m + 1, math.ceil((highest_m - lowest_m) / _MAX_LEVELS))
    )
    ticks = "".join(
        f'<text x="{x(value):.1f}" y="{_TOP + _PLOT_HEIGHT + 15}" text-anchor="middle">'
        f"{_tick(CLASS_EDGE, value / 100, f'{value:g}')}</text>"
        for value in (index * step_cm for index in range(round(end_cm / step_cm) + 1))
    )
    return (
        f'<svg class="profile" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img"'
        ' aria-label="diameters along the stem">'
        f'<text class="name" x="{_LEFT}" y="13">height {_HEIGHTS_FROM[profile.heights_from]},'
        f" {unit_name(PROFILE_HEIGHT)}</text>{levels}{ticks}"
        f'<text x="{_LEFT + _PLOT_WIDTH}" y="{_TOP + _PLOT_HEIGHT + 29}" text-anchor="end">'
        f"diameter, {unit_name(CLASS_EDGE)}</text>"
        f'<g class="first"><path class="band" d="M{band}Z"/>'
        f'<path class="line" d="M{path(diameter_cm.tolist(), heights_m)}"/></g></svg>'
    )


def _tick(quantity: str, value_m: float, text: str) -> str:
    return f"<tspan data-bare {length_attributes(quantity, value_m)}>{text}</tspan>"
