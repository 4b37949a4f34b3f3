"""Diameters along one stem in the report: a chart, the taper and the volume of the seen part."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from basetree.page import charts
from basetree.page.axis import Axis
from edgetree.measure import Estimate, StemProfile, TreeMeasurement
from edgetree.measure.volume import VOLUME_SOURCE
from edgetree.report.units import (
    CLASS_EDGE,
    PROFILE_HEIGHT,
    length_attributes,
    tick_text,
    unit_name,
)
from edgetree.results.units import AMOUNTS

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
    low_cm, high_cm = diameter_cm - spread_cm, diameter_cm + spread_cm
    heights_m: list[float] = profile.height_m.tolist()
    plot = charts.Plot(
        Axis.rounded(
            0.0,
            float(high_cm.max()),
            f"diameter, {unit_name(CLASS_EDGE)}",
            text=lambda value_cm: tick_text(CLASS_EDGE, value_cm / 100, f"{value_cm:g}"),
        ),
        Axis.rounded(
            min(0.0, heights_m[0]),
            heights_m[-1],
            f"height {_HEIGHTS_FROM[profile.heights_from]}, {unit_name(PROFILE_HEIGHT)}",
            parts=_MAX_LEVELS,
            whole=True,
            text=lambda value_m: tick_text(PROFILE_HEIGHT, value_m, f"{value_m:g}"),
        ),
        (270, 220),
    )
    outline_cm = [*low_cm.tolist(), *high_cm[::-1].tolist()]
    band = plot.line(zip(outline_cm, heights_m + heights_m[::-1], strict=True), "band")
    line = plot.line(zip(diameter_cm.tolist(), heights_m, strict=True))
    return plot.svg("diameters along the stem", charts.series(0, band, line), kind="profile")
