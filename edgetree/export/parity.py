"""Limits on the differences between a file and its model, and the report of a comparison."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Final

from edgetree.errors import CheckFailed

__all__ = ["FrameParity", "Limits", "ParityFailed", "ParityReport", "limits_of"]

_MATCH_IOU: Final = 0.5


@dataclass(frozen=True)
class Limits:
    """Largest allowed differences between a file and its model. None means no limit.

    Attributes:
        box_px: largest difference of a box coordinate, in pixels of the input.
        keypoint_px: largest difference of a keypoint coordinate, in pixels of the input.
        score: largest difference of a score.
        keypoint_score: largest difference of a keypoint's score.
        mask_iou: smallest intersection over union of two masks.
        match_iou: intersection over union of boxes from which two detections are the same tree.
        matched: smallest fraction of trees that both must find. For ``float32`` all trees count,
            otherwise those with a score of 0.5 or more.
        ap_loss: largest loss of average precision, in percentage points.
    """

    box_px: float | None = None
    keypoint_px: float | None = None
    score: float | None = None
    keypoint_score: float | None = None
    mask_iou: float | None = None
    match_iou: float = _MATCH_IOU
    matched: float = 1.0
    ap_loss: float | None = None


FLOAT32_LIMITS: Final = Limits(0.5, 0.5, 1e-3, 1e-3, 0.98)
FLOAT16_LIMITS: Final = Limits(match_iou=0.8, matched=0.99, ap_loss=0.2)
INT8_LIMITS: Final = Limits(match_iou=0.8, matched=0.95, ap_loss=1.0)
_LIMITS: Final = {"float32": FLOAT32_LIMITS, "float16": FLOAT16_LIMITS, "int8": INT8_LIMITS}


def limits_of(precision: str, *, trained: bool = True) -> Limits:
    """The limits for a precision.

    Args:
        precision: ``float32``, ``float16`` or ``int8``.
        trained: whether the network is trained. The scores and boxes of an untrained one change
            too much by rounding, so there is no limit for it except in ``float32``.
    """
    limits = _LIMITS[precision]
    return limits if trained or precision == "float32" else Limits(matched=0.0)


@dataclass(frozen=True)
class FrameParity:
    """Comparison on one frame. Differences are the largest over the matched trees.

    Attributes:
        name: name of the frame.
        trees: number of trees to match, counted in both directions.
        matched: how many of them are matched.
        box_px: difference of a box coordinate, in pixels of the input.
        keypoint_px: difference of a keypoint coordinate, in pixels of the input.
        score: difference of a score.
        keypoint_score: difference of a keypoint's score.
        mask_iou: smallest intersection over union of two masks.
        fault: why the file's outputs are invalid, or None.
    """

    name: str
    trees: int
    matched: int
    box_px: float = 0.0
    keypoint_px: float = 0.0
    score: float = 0.0
    keypoint_score: float = 0.0
    mask_iou: float = 1.0
    fault: str | None = None


@dataclass(frozen=True)
class ParityReport:
    """Comparison of a file with its model.

    Attributes:
        precision: ``float32``, ``float16`` or ``int8``.
        frames: comparison on each frame.
        average_precision: in percent, of the model and of the file, for ``box``, ``mask`` and
            ``keypoint``; empty without labels.
        limits: largest allowed differences.
    """

    precision: str
    frames: tuple[FrameParity, ...]
    average_precision: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)

    @property
    def trees(self) -> int:
        """Number of trees to match, counted in both directions."""
        return sum(frame.trees for frame in self.frames)

    @property
    def matched(self) -> float:
        """Fraction of the trees that are matched; 1 if there are none."""
        found = sum(frame.matched for frame in self.frames)
        return found / self.trees if self.trees else 1.0

    def faults(self) -> list[str]:
        """One line for each exceeded limit; empty if the file passes."""
        found = [f"{f.name}: {f.fault}" for f in self.frames if f.fault is not None]
        if not found and self.trees == 0 and self.limits.matched > 0:
            found.append("all: no tree to compare, expected frames in which the model finds some")
        for name in ("box_px", "keypoint_px", "score", "keypoint_score"):
            limit = getattr(self.limits, name)
            for frame in self.frames:
                value = getattr(frame, name)
                if limit is not None and not value <= limit:
                    found.append(f"{frame.name}: {name} differs by {value:.4g}, limit {limit:g}")
        for frame in self.frames:
            if self.limits.mask_iou is not None and not frame.mask_iou >= self.limits.mask_iou:
                limit = self.limits.mask_iou
                found.append(f"{frame.name}: mask_iou is {frame.mask_iou:.4g}, limit {limit:g}")
        if self.matched < self.limits.matched:
            found.append(
                f"all: {self.matched:.1%} of {self.trees} trees matched,"
                f" limit {self.limits.matched:.0%}"
            )
        most = self.limits.ap_loss
        for name, (model, file) in self.average_precision.items():
            if most is not None and model - file > most:
                found.append(f"all: {name} AP fell from {model:.2f} to {file:.2f}, limit {most:g}")
        return found

    def figures(self) -> dict[str, Any]:
        """A JSON-ready summary, for the manifest."""
        worst = {
            f"{name}_max": max((getattr(frame, name) for frame in self.frames), default=0.0)
            for name in ("box_px", "keypoint_px", "score", "keypoint_score")
        }
        return {
            "frames": len(self.frames),
            "trees_compared": self.trees,
            "matched_fraction": round(self.matched, 4),
            **{name: float(f"{value:.4g}") for name, value in worst.items()},
            "mask_iou_min": round(min((f.mask_iou for f in self.frames), default=1.0), 4),
            "average_precision": {
                name: {"model": round(model, 3), "file": round(file, 3)}
                for name, (model, file) in self.average_precision.items()
            },
            "limits": asdict(self.limits),
        }

    def table(self) -> str:
        """A table as text, with one line per frame."""
        head = f"{'frame':16}{'trees':>6}{'match':>6}{'box px':>9}{'kp px':>9}{'score':>10}"
        lines = [head + f"{'kp score':>10}{'mask IoU':>10}"]
        for f in self.frames:
            lines.append(
                f"{f.name[:15]:16}{f.trees:6}{f.matched:6}{f.box_px:9.4f}{f.keypoint_px:9.4f}"
                f"{f.score:10.2e}{f.keypoint_score:10.2e}{f.mask_iou:10.4f}"
            )
        for name, (model, file) in self.average_precision.items():
            lines.append(f"{name} AP: model {model:.2f}, file {file:.2f}")
        return "\n".join(lines)


class ParityFailed(CheckFailed):
    """A file differs from its model by more than the limits.

    Attributes:
        report: the comparison.
    """

    def __init__(self, message: str, report: ParityReport) -> None:
        super().__init__(message)
        self.report = report
