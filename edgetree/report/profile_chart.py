"""Chart of the diameters along one stem, as SVG."""

from __future__ import annotations

import math
from typing import Final

from edgetree.measure import StemProfile
from edgetree.report.charts import nice_axis
from edgetree.report.units import CLASS_EDGE, PROFILE_HEIGHT, length_attributes, unit_name

__all__ = ["profile_chart"]

_LEFT, _TOP, _PLOT_WIDTH, _PLOT_HEIGHT = 38, 24, 214, 150
_WIDTH, _HEIGHT = _LEFT + _PLOT_WIDTH + 18, _TOP + _PLOT_HEIGHT + 34
_STDS: Final = 1.96
_HEIGHTS_FROM: Final = {"ground": "above the ground", "section": "from the section"}


def profile_chart(profile: StemProfile) -> str:
    """The diameters over the height, with their 95 % intervals, folded until a click."""
    diameter_cm = 100 * profile.diameter_m
    spread_cm = 100 * _STDS * profile.diameter_std_m
    end_cm, step_cm = nice_axis(float((diameter_cm + spread_cm).max()))
    lowest_m = min(0, math.floor(profile.height_m[0]))
    highest_m = max(math.ceil(profile.height_m[-1]), lowest_m + 1)

    def x(value_cm: float) -> float:
        return _LEFT + _PLOT_WIDTH * value_cm / end_cm

    def y(value_m: float) -> float:
        return _TOP + _PLOT_HEIGHT * (highest_m - value_m) / (highest_m - lowest_m)

    def path(values_cm: list[float], heights_m: list[float]) -> str:
        return "L".join(
            f"{x(value):.1f} {y(height):.1f}"
            for value, height in zip(values_cm, heights_m, strict=True)
        )

    heights_m = profile.height_m.tolist()
    band = (diameter_cm - spread_cm).tolist() + (diameter_cm + spread_cm).tolist()[::-1]
    every_m = math.ceil((highest_m - lowest_m) / 8)
    levels = "".join(
        f'<path class="axis" d="M{_LEFT} {y(level):.1f}H{_LEFT + _PLOT_WIDTH}"/>'
        f'<text x="{_LEFT - 6}" y="{y(level) + 4:.1f}" text-anchor="end">'
        f"<tspan data-bare {length_attributes(PROFILE_HEIGHT, float(level))}>{level}</tspan></text>"
        for level in range(lowest_m, highest_m + 1, every_m)
    )
    ticks = "".join(
        f'<text x="{x(value):.1f}" y="{_TOP + _PLOT_HEIGHT + 15}" text-anchor="middle">'
        f"<tspan data-bare {length_attributes(CLASS_EDGE, value / 100)}>{value:g}</tspan></text>"
        for value in (index * step_cm for index in range(round(end_cm / step_cm) + 1))
    )
    return (
        f'<details><summary>profile</summary><svg class="profile" viewBox="0 0 {_WIDTH} {_HEIGHT}"'
        ' role="img" aria-label="diameters along the stem">'
        f'<text class="name" x="{_LEFT}" y="13">height {_HEIGHTS_FROM[profile.heights_from]},'
        f" {unit_name(PROFILE_HEIGHT)}</text>{levels}{ticks}"
        f'<text x="{_LEFT + _PLOT_WIDTH}" y="{_TOP + _PLOT_HEIGHT + 29}" text-anchor="end">'
        f"diameter, {unit_name(CLASS_EDGE)}</text>"
        f'<g class="first"><path class="band" d="M{path(band, heights_m + heights_m[::-1])}Z"/>'
        f'<path class="line" d="M{path(diameter_cm.tolist(), heights_m)}"/></g></svg></details>'
    )
