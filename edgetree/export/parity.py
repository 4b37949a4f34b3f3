"""The report of a comparison of a file with its model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal

import numpy as np

from basetree.counts import counted
from basetree.errors import CheckFailed
from edgetree.export.limits import ParityLimits

_LARGEST: Final = (
    "box_px",
    "keypoint_px",
    "keypoint_std_px",
    "score",
    "keypoint_score",
    "mask_probability",
)
# Name of the values of each percentile, and percent.
_PERCENTILES: Final = {
    "score_median": ("score", 50),
    "keypoint_score_median": ("keypoint_score", 50),
    "keypoint_shift_median": ("keypoint_shift", 50),
    "keypoint_shift_p90": ("keypoint_shift", 90),
    "keypoint_std_median": ("keypoint_std", 50),
    "keypoint_std_p90": ("keypoint_std", 90),
    "mask_probability_median": ("mask_probability", 50),
    "mask_iou_median": ("mask_iou", 50),
    "mask_iou_p10": ("mask_iou", 10),
}


@dataclass(frozen=True)
class FrameParity:
    """Comparison on one frame. Differences are the largest over the matched trees.

    Attributes:
        name: Name of the frame.
        trees: Number of trees to match, counted in both directions.
        matched: How many of them are matched.
        box_px: Difference of a box coordinate, in pixels of the input.
        keypoint_px: Difference of a keypoint coordinate, in pixels of the input.
        untied_keypoint_px: The same without those that `keypoint_ties` counts.
        keypoint_ties: Number of keypoints that differ by more than the limit, but whose scores
            agree. Where a heat map has two peaks of the same height, rounding decides.
        keypoint_std_px: Difference of a keypoint's standard deviation, in pixels of the input,
            without those that `keypoint_ties` counts.
        score: Difference of a score.
        keypoint_score: Difference of a keypoint's score.
        mask_probability: Difference of a mask's probability in one cell.
        mask_iou: Smallest intersection over union of two masks.
        values: One value per matched tree, by name: `score`, the difference of its score;
            `keypoint_score`, that of its keypoints (5 values per tree); `keypoint_shift`, the
            distances of its keypoints (5 values), divided by the square root of the area of its
            box; `keypoint_std`, the differences of their standard deviations, divided likewise;
            `mask_probability`, the mean difference of its mask's cells; `mask_iou`, the
            intersection over union of its masks. Without those of missing branches.
        fault: Why the file's outputs are invalid, or None.
    """

    name: str
    trees: int
    matched: int
    box_px: float = 0.0
    keypoint_px: float = 0.0
    untied_keypoint_px: float = 0.0
    keypoint_ties: int = 0
    keypoint_std_px: float = 0.0
    score: float = 0.0
    keypoint_score: float = 0.0
    mask_probability: float = 0.0
    mask_iou: float = 1.0
    values: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    fault: str | None = None


@dataclass(frozen=True)
class ParityReport:
    """Comparison of a file with its model.

    Attributes:
        precision: `float32`, `float16` or `int8`.
        frames: Comparison on each frame.
        average_precision: In percent, of the model and of the file, for `box`, `mask` and
            `keypoint`; empty without labels.
        limits: Largest allowed differences.
        not_checked: What could not be compared and why, one line each.
    """

    precision: str
    frames: tuple[FrameParity, ...]
    average_precision: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    limits: ParityLimits = field(default_factory=ParityLimits)
    not_checked: tuple[str, ...] = ()

    @property
    def trees(self) -> int:
        """Number of trees to match, counted in both directions."""
        return sum(frame.trees for frame in self.frames)

    @property
    def matched(self) -> float:
        """Share of the trees that are matched; 1 if there are none."""
        found = sum(frame.matched for frame in self.frames)
        return found / self.trees if self.trees else 1.0

    @property
    def keypoints(self) -> int:
        """Number of keypoints that are compared."""
        return sum(len(frame.values.get("keypoint_score", ())) for frame in self.frames)

    @property
    def keypoint_ties(self) -> int:
        """Number of keypoints that lie elsewhere with the same score."""
        return sum(frame.keypoint_ties for frame in self.frames)

    @property
    def percentiles(self) -> dict[str, float | None]:
        """Medians, 90th and 10th percentiles of the values of all frames, by name.

        No interpolation: the percentile is the better one of the two nearest values. Thus one of
        a single tree's five keypoints, and one of two masks, may be wrong. None without values.
        """
        return {
            name: _percentile(
                [value for frame in self.frames for value in frame.values.get(kind, ())],
                percent,
                "higher" if kind == "mask_iou" else "lower",
            )
            for name, (kind, percent) in _PERCENTILES.items()
        }

    def faults(self) -> list[str]:
        """One line for each exceeded limit; empty if the file passes."""
        found = [f"{f.name}: {f.fault}" for f in self.frames if f.fault is not None]
        if not found and self.trees == 0 and self.limits.matched > 0:
            found.append("all: no tree to compare, expected frames in which the model finds some")
        return [*found, *self._faults_of_frames(), *self._faults_of_all()]

    def _faults_of_frames(self) -> Iterator[str]:
        few_ties = self.keypoint_ties <= self.limits.keypoint_ties * self.keypoints
        for name in _LARGEST:
            limit = getattr(self.limits, name)
            without_ties = f"untied_{name}" if name == "keypoint_px" and few_ties else name
            for frame in self.frames:
                value = getattr(frame, without_ties)
                if limit is not None and not value <= limit:
                    yield f"{frame.name}: {name} differs by {value:.4g}, limit {limit:g}"
        for frame in self.frames:
            if self.limits.mask_iou is not None and not frame.mask_iou >= self.limits.mask_iou:
                limit = self.limits.mask_iou
                yield f"{frame.name}: mask_iou is {frame.mask_iou:.4g}, limit {limit:g}"

    def _faults_of_all(self) -> Iterator[str]:
        if self.matched < self.limits.matched:
            limit = self.limits.matched
            yield (
                f"all: {self.matched:.1%} of {counted(self.trees, 'tree')} matched, limit"
                f" {limit:.0%}"
            )
        for name, (value, limit) in self._limited_percentiles().items():
            if not (value >= limit if name.startswith("mask_iou") else value <= limit):
                yield f"all: {name} is {value:.4g}, limit {limit:g}"
        most = self.limits.ap_loss
        for name, (model, file) in self.average_precision.items():
            if most is not None and model - file > most:
                yield f"all: {name} AP fell from {model:.2f} to {file:.2f}, limit {most:g}"

    def _limited_percentiles(self) -> dict[str, tuple[float, float]]:
        """Value and limit of each percentile that has both."""
        values, limits = self.percentiles, self.limits.percentiles
        return {n: (v, limits[n]) for n, v in values.items() if v is not None and n in limits}

    def figures(self) -> dict[str, Any]:
        """A JSON-ready summary, for the manifest."""
        worst = {
            f"{name}_max": max((getattr(frame, name) for frame in self.frames), default=0.0)
            for name in _LARGEST
        }
        return {
            "frames": len(self.frames),
            "trees_compared": self.trees,
            "matched_fraction": round(self.matched, 4),
            **{name: float(f"{value:.4g}") for name, value in worst.items()},
            "keypoint_ties": self.keypoint_ties,
            "mask_iou_min": round(min((f.mask_iou for f in self.frames), default=1.0), 4),
            "percentiles": {
                name: None if value is None else float(f"{value:.4g}")
                for name, value in self.percentiles.items()
            },
            "average_precision": {
                name: {"model": round(model, 3), "file": round(file, 3)}
                for name, (model, file) in self.average_precision.items()
            },
            "not_checked": list(self.not_checked),
            "limits": asdict(self.limits),
        }

    def table(self) -> str:
        """A table as text, with one line per frame, and a summary."""
        head = f"{'frame':16}{'trees':>6}{'match':>6}{'box px':>9}{'kp px':>9}"
        lines = [head + f"{'score':>9}{'kp score':>9}{'mask p':>9}{'mask IoU':>9}"]
        for f in self.frames:
            lines.append(
                f"{f.name[:15]:16}{f.trees:6}{f.matched:6}{f.box_px:9.4f}{f.keypoint_px:9.4f}"
                f"{f.score:9.1e}{f.keypoint_score:9.1e}{f.mask_probability:9.1e}{f.mask_iou:9.4f}"
            )
        if self.keypoint_ties:
            lines.append(
                f"keypoints elsewhere with the same score: {self.keypoint_ties} of"
                f" {self.keypoints}, limit {self.limits.keypoint_ties:.1%}"
            )
        for name, (value, limit) in self._limited_percentiles().items():
            lines.append(f"{name.replace('_', ' ')}: {value:.4f}, limit {limit:g}")
        for name, (model, file) in self.average_precision.items():
            lines.append(f"{name} AP: model {model:.2f}, file {file:.2f}")
        return "\n".join((*lines, *self.not_checked))


def _percentile(
    values: Sequence[float], percent: float, method: Literal["lower", "higher"]
) -> float | None:
    return float(np.percentile(values, percent, method=method)) if values else None


class ParityFailed(CheckFailed):
    """A file differs from its model by more than the limits.

    Attributes:
        report: The comparison.
    """

    def __init__(self, message: str, report: ParityReport) -> None:
        super().__init__(message)
        self.report = report
