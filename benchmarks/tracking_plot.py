"""Plots of `tracking.py`: coverage of the intervals, and errors, against the number of frames."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.plots import panels, save

QUANTITIES = {
    "diameter_m": "diameter",
    "dbh_m": "diameter at breast height",
    "cut_height_m": "cut height",
    "inclination_deg": "inclination",
}
TARGET = (0.93, 0.97)


def plot(result: dict[str, Any], path: Path) -> None:
    """Draw the coverage of all quantities, and errors beside what the intervals state."""
    figure, (left, right) = panels(1, 2, (10, 4.2))
    left.axhspan(100 * TARGET[0], 100 * TARGET[1], color="tab:green", alpha=0.15)
    fused = result["fusion"]["pose"]
    lines = [(fused[quantity], label, "o-") for quantity, label in QUANTITIES.items()]
    noise = result["fusion"]["pose, all errors as noise"]["diameter_m"]
    lines.append((noise, "diameter, if all errors were noise", "x--"))
    for number, (entry, label, style) in enumerate(lines):
        frames, held, low, high = _columns(entry)
        shifted = frames * 1.05 ** (number - 2)  # so that the bars lie side by side
        bars = 100 * np.array([np.maximum(held - low, 0), np.maximum(high - held, 0)])
        left.errorbar(shifted, 100 * held, bars, fmt=style, capsize=2, label=label, lw=1)
    left.set(
        xscale="log",
        xlabel="frames",
        ylabel="truth in the 95 % interval (%)",
        ylim=(40, 101),
        title=f"{result['stems']} stems on {result['drives']} drives",
    )
    left.legend(fontsize="x-small", loc="lower left")
    rows = fused["diameter_m"]["frames"]
    frames = np.array([int(name) for name in rows])
    for key, label in (
        ("median_abs", "median of the absolute errors"),
        ("rmse", "root mean square of the errors"),
        ("stated_rms", "root mean square of the stated deviations"),
    ):
        right.plot(frames, [100 * row[key] for row in rows.values()], "o-", label=label)
    right.set(xscale="log", xlabel="frames", ylabel="diameter (cm)", ylim=(0, None))
    right.legend(fontsize="x-small")
    for axes in (left, right):
        axes.set_xticks(frames, [str(count) for count in frames])
        axes.minorticks_off()
    save(figure, path)


def _columns(entry: dict[str, Any]) -> tuple[np.ndarray, ...]:
    """Numbers of frames, coverage, and the ends of its interval."""
    rows = entry["frames"]
    held = np.array([row["held"] for row in rows.values()])
    low, high = np.array([row["held_interval95"] for row in rows.values()]).T
    return np.array([int(name) for name in rows]), held, low, high
