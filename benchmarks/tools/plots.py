"""Plots of the results, made with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
from numpy.typing import ArrayLike

mpl.use("agg")


def panels(rows: int, columns: int, size: tuple[float, float], **options: Any) -> tuple[Any, Any]:
    """A figure and its panels.

    Args:
        rows: Rows of panels.
        columns: Columns of panels.
        size: Width and height in inches.
        **options: As for `pyplot.subplots`.
    """
    from matplotlib import pyplot

    return pyplot.subplots(rows, columns, figsize=size, layout="constrained", **options)


def save(figure: Any, path: Path) -> None:
    """Draw grids in all panels, and write the figure to a file."""
    for axes in figure.axes:
        axes.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def endurance(
    x: ArrayLike,
    x_label: str,
    latency_ms: dict[str, Sequence[float]],
    memory_mib: Sequence[float],
    counted: str,
) -> tuple[Any, Any, Any]:
    """Latency above memory over a long run.

    Args:
        x: Place of each part of the run.
        x_label: What x is.
        latency_ms: `p50` and `p99` of each part.
        memory_mib: Resident memory in each part.
        counted: What the latency is of, such as "frames".

    Returns:
        The figure and its two panels.
    """
    figure, (top, bottom) = panels(2, 1, (7, 5), sharex=True)
    for name, label in (("p99", f"99 % of the {counted} are faster"), ("p50", "median")):
        top.plot(x, latency_ms[name], label=label)
    top.set(ylabel="latency (ms)", ylim=(0, 1.5 * max(latency_ms["p99"])))
    bottom.plot(x, memory_mib, color="tab:green")
    limits_mib = (0, 1.2 * max(memory_mib))
    bottom.set(ylabel="resident memory (MiB)", xlabel=x_label, ylim=limits_mib)
    return figure, top, bottom
