"""Plot trainings from their logs: average precision, losses, learning rate and speed."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from perceptree.errors import CheckpointError
from perceptree.training.run_log import LOG_NAME, read_log

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.gridspec import GridSpec

Entry = dict[str, Any]

_COLUMNS = 3
# Fixed margins and gaps: matplotlib's layout engines take twice the time.
_PANEL_IN, _GAP_IN = (2.9, 1.6), (0.72, 0.72)
_LEFT_IN, _RIGHT_IN, _BOTTOM_IN = 0.65, 0.2, 0.5
_HEAD_IN, _LEGEND_LINE_IN = 0.85, 0.22
_DOTS_PER_INCH = 110
_SECONDS_PER_HOUR = 3600.0
_AP = {
    "box_ap": "AP of boxes on val",
    "mask_ap": "AP of masks on val",
    "keypoint_ap": "AP of keypoints on val",
}
_PACE = {"rate": "learning rate", "frames_per_s": "frames per second"}
_LOSS = "loss"
_FEW_POINTS = 6


@dataclass(frozen=True, eq=False)
class Curve:
    """Values (N,) of one measure at ascending steps (N,)."""

    steps: NDArray[np.int64]
    values: NDArray[np.float64]

    @classmethod
    def of(cls, pairs: Sequence[tuple[int, float | None]]) -> Curve:
        """Make a curve of (step, value) pairs, leaving out those without a value."""
        known = [(step, value) for step, value in pairs if value is not None]
        steps, values = zip(*known, strict=True) if known else ((), ())
        return cls(np.array(steps, np.int64), np.array(values, np.float64))


@dataclass(frozen=True, eq=False)
class RunCurves:
    """The log of one run as curves.

    Attributes:
        name: Name of the run.
        steps: (N,) steps of the log's entries.
        hours: (N,) training time at these steps.
        curves: Curve by title of its panel.
    """

    name: str
    steps: NDArray[np.int64]
    hours: NDArray[np.float64]
    curves: dict[str, Curve]

    @property
    def label(self) -> str:
        """Name, steps, hours and best box AP, for the legend."""
        text = f"{self.name}: {self.steps[-1]:,} steps, {self.hours[-1]:.1f} h"
        boxes = self.curves[_AP["box_ap"]].values
        return text + (f", best AP of boxes {boxes.max():.1f}" if len(boxes) else "")


def read_curves(run: Path, name: str) -> RunCurves:
    """Read the curves of a run.

    Args:
        run: Folder of the run.
        name: Name for the legend.

    Raises:
        CheckpointError: If the log is missing, empty or not readable.
    """
    entries = read_log(run)
    if not entries:
        raise CheckpointError(
            f"{run / LOG_NAME}: is empty, expected a training that has logged at least once"
        )
    try:
        steps = np.array([entry["step"] for entry in entries], np.int64)
        elapsed_s = np.array([entry["elapsed_s"] for entry in entries], np.float64)
        return RunCurves(name, steps, elapsed_s / _SECONDS_PER_HOUR, _curves(entries))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        raise CheckpointError(f"{run / LOG_NAME}: not the log of a training ({error!r})") from error


def _curves(entries: list[Entry]) -> dict[str, Curve]:
    trained = [entry for entry in entries if "losses" in entry]
    scored = [entry for entry in entries if "val" in entry]
    names = dict.fromkeys(name for entry in trained for name in entry["losses"])
    curves = {
        title: Curve.of([(e["step"], e["val"][key]) for e in scored]) for key, title in _AP.items()
    }
    curves[f"total {_LOSS}"] = Curve.of([(e["step"], sum(e["losses"].values())) for e in trained])
    for key, title in _PACE.items():
        curves[title] = Curve.of([(e["step"], e[key]) for e in trained])
    for name in names:
        pairs = [(e["step"], e["losses"].get(name)) for e in trained]
        curves[f"{name.replace('_', ' ')} {_LOSS}"] = Curve.of(pairs)
    return curves


def draw_runs(folders: Sequence[Path]) -> bytes:
    """Plot runs into one image, a colour per run and a panel per measure.

    Losses have a logarithmic axis. The training time of a single run is on a second axis; that of
    several runs is in the legend.

    Args:
        folders: Folders of the runs.

    Returns:
        The content of a PNG file.

    Raises:
        CheckpointError: If a log is missing, empty or not readable.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    runs = [read_curves(f, name) for f, name in zip(folders, _names(folders), strict=True)]
    titles = list(dict.fromkeys(title for run in runs for title in run.curves))
    rows = -(-len(titles) // _COLUMNS)
    figure, grid = _grid(rows, _HEAD_IN + _LEGEND_LINE_IN * len(runs))
    for panel, title in enumerate(titles):
        axes = figure.add_subplot(grid[panel // _COLUMNS, panel % _COLUMNS])
        _draw(axes, [run.curves.get(title) for run in runs], title)
        _style_axes(axes, runs, logarithmic=title.endswith(_LOSS))
        if panel < _COLUMNS and len(runs) == 1:
            _add_hours(axes, runs[0])
    _add_legend(figure, runs)
    buffer = io.BytesIO()
    FigureCanvasAgg(figure).print_png(buffer)  # type: ignore[no-untyped-call]
    return buffer.getvalue()


def _grid(rows: int, head_in: float) -> tuple[Figure, GridSpec]:
    """A figure with a legend area of `head_in` inches and a grid of `rows` rows of panels."""
    from matplotlib.figure import Figure

    (wide, high), (beside, below) = _PANEL_IN, _GAP_IN
    width_in = _LEFT_IN + _COLUMNS * wide + (_COLUMNS - 1) * beside + _RIGHT_IN
    height_in = head_in + rows * high + (rows - 1) * below + _BOTTOM_IN
    figure = Figure(figsize=(width_in, height_in), dpi=_DOTS_PER_INCH)
    grid = figure.add_gridspec(
        rows,
        _COLUMNS,
        left=_LEFT_IN / width_in,
        right=1 - _RIGHT_IN / width_in,
        bottom=_BOTTOM_IN / height_in,
        top=1 - head_in / height_in,
        wspace=beside / wide,
        hspace=below / high,
    )
    return figure, grid


def _names(folders: Sequence[Path]) -> list[str]:
    """The folders' names, or their paths if two have the same name."""
    own = [folder.resolve().name for folder in folders]
    return own if len(set(own)) == len(own) else [str(folder) for folder in folders]


def _draw(axes: Axes, curves: Sequence[Curve | None], title: str) -> None:
    for number, curve in enumerate(curves):
        if curve is not None and len(curve.steps):
            marker = "." if len(curve.steps) < _FEW_POINTS else ""
            axes.plot(curve.steps, curve.values, color=f"C{number % 10}", lw=1.4, marker=marker)
    axes.set_title(title, fontsize=10)


def _style_axes(axes: Axes, runs: Sequence[RunCurves], logarithmic: bool) -> None:
    first = min(0, *(int(run.steps[0]) for run in runs))
    axes.set_xlim(first, max(1.02 * int(run.steps[-1]) for run in runs))
    axes.grid(color="0.9")
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=8)
    axes.set_xlabel("step", fontsize=8)
    values = np.concatenate([[], *(line.get_ydata() for line in axes.get_lines())])
    if not len(values):
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", color="0.5")
        axes.set_yticks([])
    elif logarithmic and (values > 0).any():
        axes.set_yscale("log")
        _label_logarithms(axes)
    else:
        axes.set_ylim(0, 1.08 * max(float(values.max()), 1e-9))


def _label_logarithms(axes: Axes) -> None:
    """Label 1, 2 and 5 of every power of ten; all digits if the curves span less than 5 times."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axes.get_ylim()
    subs = (1.0, 2.0, 5.0) if high > 5 * low else tuple(float(n) for n in range(1, 10))
    axes.yaxis.set_major_locator(LogLocator(subs=subs, numticks=8))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _add_hours(axes: Axes, run: RunCurves) -> None:
    """Add an axis of the training time on top."""
    from matplotlib.ticker import MaxNLocator

    hours = np.maximum.accumulate(run.hours)
    ticks = MaxNLocator(nbins=4).tick_values(0.0, float(hours[-1]))
    ticks = ticks[(ticks >= hours[0]) & (ticks <= hours[-1])]
    above = axes.secondary_xaxis("top")
    above.set_xticks(np.interp(ticks, hours, run.steps), [f"{tick:g}" for tick in ticks])
    above.tick_params(labelsize=8)
    above.set_xlabel("hours of training", fontsize=8)


def _add_legend(figure: Figure, runs: Sequence[RunCurves]) -> None:
    from matplotlib.lines import Line2D

    lines = [Line2D([], [], color=f"C{n % 10}", lw=3) for n in range(len(runs))]
    figure.legend(lines, [run.label for run in runs], loc="upper left", frameon=False)
