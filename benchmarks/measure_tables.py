"""Tables of the accuracy of metric measurements, from the values of single trees."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import numpy as np

# Measured quantity -> label with its true value.
TRUTHS = {
    "diameter_m": "diameter_m",
    "dbh_m": "diameter_breast_m",
    "cut_height_m": "cut_height_m",
    "inclination_deg": "inclination_deg",
    "distance_m": "distance_m",
}
BANDS_M = ((0.0, 5.0), (5.0, 7.5), (7.5, 11.0))

Row = dict[str, Any]


def tables(rows: list[Row]) -> dict[str, Any]:
    """Make all tables."""
    clear = [row for row in rows if row["found"] and row["visible_fraction"] >= 0.5]
    labelled = [row for row in rows if row["visible_fraction"] >= 0.5]
    of_given_cut = [
        {**row, "true_cut_height_m": row["true_given_cut_height_m"]}
        for row in rows
        if row.get("true_given_cut_height_m") is not None
    ]
    return {
        "trees": len(rows),
        "found": sum(row["found"] for row in rows),
        "diameter_measured_of_visible_half": _share(labelled, "diameter_m"),
        "diameter_measured_of_found_visible_half": _share(clear, "diameter_m"),
        "quantities": {name: errors(rows, name) for name in TRUTHS},
        "height_of_given_cut": errors(of_given_cut, "cut_height_m"),
        "diameter_by_distance": _by(rows, "true_distance_m", (0, 2.5, 5, 7.5, 11)),
        "naive_diameter_by_distance": _naive(rows, (0, 2.5, 5, 7.5, 11)),
        "diameter_by_diameter": _by(rows, "true_diameter_m", (0, 0.1, 0.2, 0.3, 1.0)),
        "diameter_by_lean": _by(rows, "true_inclination_deg", (0, 3, 6, 10, 90)),
        "diameter_by_visible_fraction": _by(
            rows, "visible_fraction", (0, 0.3, 0.5, 0.8, 0.95, 1.01)
        ),
        "diameter_by_sensor": {
            kind: errors([row for row in rows if row["sensor"] == kind], "diameter_m")
            for kind in sorted({row["sensor"] for row in rows})
        },
        "intervals": {name: intervals(rows, name) for name in TRUTHS},
        "failures": _counted(row.get("diameter_failure", "") for row in rows if row["found"]),
    }


def values(rows: Iterable[Row], name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """True value, error and stated standard deviation of the rows with a measured quantity."""
    stem, unit = name.rsplit("_", 1)
    kept = [row for row in rows if name in row]
    truth = np.array([row[f"true_{name}"] for row in kept], float)
    found = np.array([row[name] for row in kept], float)
    return truth, found - truth, np.array([row[f"{stem}_std_{unit}"] for row in kept], float)


def errors(rows: Iterable[Row], name: str) -> dict[str, float | int | None]:
    """Count, median and 90th percentile of the absolute error, bias, and RMS error."""
    _, error, std = values(rows, name)
    if not len(error):
        return {"measured": 0}
    absolute = np.abs(error)
    return {
        "measured": len(error),
        "median_abs": _rounded(np.median(absolute)),
        "p90_abs": _rounded(np.percentile(absolute, 90)),
        "bias": _rounded(np.median(error)),
        "rmse": _rounded(np.sqrt(np.mean(error**2))),
        "median_std": _rounded(np.median(std)),
    }


def intervals(rows: list[Row], name: str) -> dict[str, Any]:
    """Fraction of true values in the stated 95 % interval, by distance and stated deviation."""
    _, error, std = values(rows, name)
    if not len(error):
        return {}
    held = np.abs(error) <= 1.96 * std
    distance = np.array([row["true_distance_m"] for row in rows if name in row])
    thirds = np.array_split(np.argsort(std), 3)
    return {
        "all": _rounded(held.mean()),
        "by_distance": {
            f"{low:g}-{high:g} m": [_rounded(held[band].mean()), int(band.sum())]
            for low, high in BANDS_M
            if (band := (distance >= low) & (distance < high)).any()
        },
        "by_third_of_std": [_rounded(held[third].mean()) for third in thirds if len(third)],
    }


def _naive(rows: list[Row], edges: tuple[float, ...]) -> dict[str, Any]:
    """Errors of the simple estimate: depth times pixel width over focal length."""
    result = {}
    for low, high in pairwise(edges):
        within = [
            r for r in rows if r["naive_m"] is not None and low <= r["true_distance_m"] < high
        ]
        truth = np.array([row["true_diameter_m"] for row in within])
        error = np.array([row["naive_m"] for row in within]) - truth
        result[f"{low:g}-{high:g}"] = {
            "trees": len(within),
            "median_abs": _rounded(np.median(np.abs(error))) if len(error) else None,
            "median_share": _rounded(np.median(error / truth)) if len(error) else None,
        }
    return result


def _by(rows: list[Row], key: str, edges: tuple[float, ...]) -> dict[str, Any]:
    """Diameter errors by ranges of another quantity."""
    result = {}
    for low, high in pairwise(edges):
        within = [row for row in rows if low <= row[key] < high]
        result[f"{low:g}-{high:g}"] = {"trees": len(within), **errors(within, "diameter_m")}
    return result


def _share(rows: list[Row], name: str) -> float | None:
    return _rounded(np.mean([name in row for row in rows])) if rows else None


def _counted(reasons: Iterable[str]) -> dict[str, int]:
    """Count the reasons, ignoring the numbers in their text."""
    counts: dict[str, int] = {}
    for reason in reasons:
        words = " ".join(word for word in reason.split() if not any(c.isdigit() for c in word))
        counts[words] = counts.get(words, 0) + 1
    return dict(sorted(counts.items(), key=lambda pair: -pair[1]))


def _rounded(value: Any) -> float:
    return round(float(value), 4)
