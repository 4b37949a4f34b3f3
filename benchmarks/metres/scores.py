"""Scores of a row of scenes: what is given, how far it is off, and whether the intervals hold."""

from __future__ import annotations

from collections.abc import Iterable
from statistics import NormalDist
from typing import Any

import numpy as np

from edgetree.measure import Estimate, PointEstimate, TreeMeasurement

QUANTITIES = (
    "diameter_m",
    "dbh_m",
    "cut_height_m",
    "inclination_deg",
    "distance_m",
    "axis_distance_m",
    "cut_point_m",
)
LEVELS = (0.5, 0.68, 0.9, 0.95, 0.99)


def score(
    readings: Iterable[tuple[TreeMeasurement, dict[str, Any]]],
    quantities: tuple[str, ...] = QUANTITIES,
) -> dict[str, dict[str, Any]]:
    """Scores by quantity. A point counts as three readings, one for each coordinate."""
    errors: dict[str, list[tuple[float, float, bool, list[bool]]]] = {n: [] for n in quantities}
    asked, given = dict.fromkeys(quantities, 0), dict.fromkeys(quantities, 0)
    for tree, truth in readings:
        for name in quantities:
            value = getattr(tree, name)
            asked[name] += 1
            if isinstance(value, Estimate):
                found = [(value, truth[name])]
            elif isinstance(value, PointEstimate):
                pairs = zip(value.xyz_m.tolist(), value.std_m.tolist(), truth[name], strict=True)
                found = [(Estimate(at, std), true) for at, std, true in pairs]
            else:
                continue
            given[name] += 1
            warned = bool(tree.evidence.warnings)
            for each, true in found:
                inside = [_holds(each, level, true) for level in LEVELS]
                errors[name].append((each.value - true, each.std, warned, inside))
    return {name: _summary(asked[name], given[name], errors[name]) for name in quantities}


def _holds(value: Estimate, level: float, true: float) -> bool:
    if hasattr(value, "interval"):
        low, high = value.interval(level)
        return bool(low <= true <= high)
    return bool(abs(value.value - true) <= NormalDist().inv_cdf((1 + level) / 2) * value.std)


def _summary(
    asked: int, given: int, errors: list[tuple[float, float, bool, list[bool]]]
) -> dict[str, Any]:
    if not errors:
        return {"stems": asked, "given": 0}
    error = np.array([each[0] for each in errors])
    std = np.array([each[1] for each in errors])
    warned = np.array([each[2] for each in errors])
    inside = np.array([each[3] for each in errors]).mean(0)
    beyond = np.abs(error) > 3 * std
    return {
        "stems": asked,
        "given": given,
        "bias": round(float(error.mean()), 4),
        "rmse": round(float(np.sqrt((error**2).mean())), 4),
        "median_std": round(float(np.median(std)), 4),
        "inside": [round(float(share), 3) for share in inside],
        "beyond3": round(float(beyond.mean()), 4),
        "beyond3_without_warning": round(float((beyond & ~warned).mean()), 4),
        "largest_sigma": round(float((np.abs(error) / std).max()), 1),
    }


def lines(row: str, scores: dict[str, dict[str, Any]]) -> list[str]:
    """The scores of a row as lines of text."""
    result = [
        f"{row}: given/stems, bias, RMSE, median std | inside 50 68 90 95 99 % | beyond 3 (silent)"
    ]
    for name, each in scores.items():
        text = f"  {name:16s} {each['given']:4d}/{each['stems']}"
        if each["given"]:
            inside = " ".join(f"{100 * share:3.0f}" for share in each["inside"])
            text += (
                f" {each['bias']:8.3f} {each['rmse']:7.3f} {each['median_std']:7.3f} | {inside} |"
                f" {100 * each['beyond3']:4.1f} % ({100 * each['beyond3_without_warning']:.1f} %),"
                f" largest {each['largest_sigma']:g}"
            )
        result.append(text)
    return result
