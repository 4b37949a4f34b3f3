"""Does a file find what its model finds? Detections of both are matched and compared."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calib import box_iou
from edgetree.errors import CheckFailed

__all__ = [
    "UNMATCHED_FRAMES",
    "Arrays",
    "FrameParity",
    "Limits",
    "ParityFailed",
    "ParityReport",
    "compare_frame",
    "compare_frames",
    "limits_of",
]

Arrays = Mapping[str, NDArray[Any]]
Detect = Callable[[NDArray[np.uint8]], Arrays]

MATCH_IOU: Final = 0.5
SCORE_OF_INTEREST: Final = 0.5
# A quantised score may fall this far below the score of interest and still count as found.
SCORE_SLACK: Final = 0.1
# Frames on which networks answer with ties, whose order is anybody's; only sanity counts there.
UNMATCHED_FRAMES: Final = ("blank", "noise")
SCORE_ROUNDING: Final = 1e-3


@dataclass(frozen=True)
class Limits:
    """How far a file may be from its model; None for what is not limited.

    Pixels are those of the input. ``match_iou`` is the overlap from which two detections are the
    same tree, ``matched`` the least fraction of trees scored 0.5 or more that both find,
    ``ap_loss`` the most points of average precision that may be lost.
    """

    box_px: float | None = None
    keypoint_px: float | None = None
    score: float | None = None
    keypoint_score: float | None = None
    mask_iou: float | None = None
    match_iou: float = MATCH_IOU
    matched: float = 1.0
    ap_loss: float | None = None


FLOAT32_LIMITS: Final = Limits(0.5, 0.5, 1e-3, 1e-3, 0.98)
FLOAT16_LIMITS: Final = Limits(match_iou=0.8, matched=0.99, ap_loss=0.2)
INT8_LIMITS: Final = Limits(match_iou=0.8, matched=0.95, ap_loss=1.0)
_LIMITS: Final = {"float32": FLOAT32_LIMITS, "float16": FLOAT16_LIMITS, "int8": INT8_LIMITS}


def limits_of(precision: str, *, trained: bool = True) -> Limits:
    """The limits of ``float32``, ``float16`` or ``int8``.

    An untrained network's scores and boxes do not survive rounding: beside float32 only sanity
    counts there.
    """
    limits = _LIMITS[precision]
    return limits if trained or precision == "float32" else Limits(matched=0.0)


@dataclass(frozen=True)
class FrameParity:
    """What one frame showed: largest differences over matched trees, and how many matched."""

    name: str
    trees: int
    matched: int
    box_px: float = 0.0
    keypoint_px: float = 0.0
    score: float = 0.0
    keypoint_score: float = 0.0
    mask_iou: float = 1.0
    fault: str | None = None
    """Why the outputs make no sense at all, if so."""


@dataclass(frozen=True)
class ParityReport:
    """All frames and the verdict.

    ``average_precision`` has, where labels were given, the model's and the file's, in percent, of
    ``box``, ``mask`` and ``keypoint``.
    """

    precision: str
    frames: tuple[FrameParity, ...]
    average_precision: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    limits: Limits = field(default_factory=Limits)

    @property
    def trees(self) -> int:
        """Trees looked for, in both directions."""
        return sum(frame.trees for frame in self.frames)

    @property
    def matched(self) -> float:
        """Fraction of them that was found; 1 where there were none to find."""
        found = sum(frame.matched for frame in self.frames)
        return found / self.trees if self.trees else 1.0

    def faults(self) -> list[str]:
        """One line for each limit that does not hold; empty if the file passes."""
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
        """JSON-ready summary for the manifest."""
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
        """The frames as text, one line each."""
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
    """A file differs from its model by more than the limits; ``report`` tells where."""

    def __init__(self, message: str, report: ParityReport) -> None:
        super().__init__(message)
        self.report = report


def compare_frames(
    model: Detect,
    file: Detect,
    frames: Mapping[str, NDArray[np.uint8]],
    precision: str,
    threshold: float,
    batch: int = 1,
    unmatched: Sequence[str] = UNMATCHED_FRAMES,
) -> tuple[FrameParity, ...]:
    """Run both on every frame, uint8 as the model takes it without the batch axis.

    They go through in batches of ``batch``, the last one filled up with the first frames.
    ``threshold`` is the score that the graph keeps detections from. On the ``unmatched`` frames
    only sanity counts.
    """
    names, results = list(frames), []
    for start in range(0, len(names), batch):
        taken = [names[i % len(names)] for i in range(start, start + batch)]
        images = np.stack([frames[name] for name in taken])
        expected, found = model(images), file(images)
        fault = _missing(found, expected)
        for row, name in enumerate(taken[: len(names) - start]):
            if fault is not None:
                results.append(FrameParity(name, 0, 0, fault=fault))
                continue
            ours, theirs = _row(expected, row), _row(found, row)
            fault = _nonsense(theirs, threshold)
            if fault is not None or name in unmatched:
                results.append(FrameParity(name, 0, 0, fault=fault))
                continue
            pair = _used(ours), _used(theirs)
            results.append(compare_frame(name, *pair, precision, threshold))
    return tuple(results)


def _row(outputs: Arrays, row: int) -> Arrays:
    return {name: values[row] for name, values in outputs.items()}


def _missing(found: Arrays, expected: Arrays) -> str | None:
    for name in expected:
        if name not in found or found[name].shape != expected[name].shape:
            return f"{name} is missing or of another shape"
    return None


def _nonsense(found: Arrays, threshold: float) -> str | None:
    """What no detector may answer, whatever the frame."""
    for name, values in found.items():
        if not np.isfinite(values).all():
            return f"{name} is not finite"
    count, rows = int(found["num_detections"]), len(found["boxes"])
    if not 0 <= count <= rows:
        return f"num_detections is {count}, expected 0 to {rows}"
    if any(found[name][count:].any() for name in found if name != "num_detections"):
        return "rows past num_detections are not zero"
    lowest = found["scores"][:count].min(initial=1.0)
    if lowest < threshold - SCORE_ROUNDING:
        return f"a score is {lowest:.4g}, expected {threshold:g} or more, as the manifest says"
    return None


def _used(outputs: Arrays) -> Arrays:
    """One image's rows in use, and how many there could be."""
    count = int(outputs["num_detections"])
    return {
        name: values[:count] for name, values in outputs.items() if name != "num_detections"
    } | {"rows": np.array(len(outputs["boxes"]))}


def compare_frame(
    name: str, expected: Arrays, found: Arrays, precision: str, threshold: float
) -> FrameParity:
    """Match the trees of one frame by overlap and measure how far they differ.

    Both hold ``boxes`` (N, 4), ``scores`` (N,), maybe ``keypoints`` (N, 5, 3) and ``masks``
    (N, 28, 28), and ``rows``, the most there could be.
    """
    limits = limits_of(precision)
    overlap = box_iou(expected["boxes"], found["boxes"])
    if precision == "float32":
        slack = limits.score or 0.0
        low = [_lowest_certain(side, threshold, slack) for side in (expected, found)]
        partner = [threshold, threshold]
    else:
        low = [SCORE_OF_INTEREST] * 2
        partner = [SCORE_OF_INTEREST - SCORE_SLACK] * 2
    trees, matched = 0, 0
    pairs: list[tuple[int, int]] = []
    for side, (ours, theirs, iou) in enumerate(
        ((expected, found, overlap), (found, expected, overlap.T))
    ):
        wanted = np.flatnonzero(ours["scores"] >= low[side])
        trees += len(wanted)
        allowed = np.where(theirs["scores"] >= partner[side], 1.0, 0.0)[None]
        for i in wanted:
            best = int((iou[i] * allowed[0]).argmax()) if iou.shape[1] else -1
            if best >= 0 and iou[i, best] * allowed[0, best] >= limits.match_iou:
                matched += 1
                pairs.append((int(i), best) if side == 0 else (best, int(i)))
    return _differences(name, expected, found, sorted(set(pairs)), trees, matched)


def _lowest_certain(side: Arrays, threshold: float, slack: float) -> float:
    """The score from which a row cannot have come or gone by a rounding of the scores."""
    scores = side["scores"]
    full = len(scores) == int(side["rows"]) and len(scores) > 0
    return float(max(threshold, scores.min() if full else 0.0)) + slack


def _differences(
    name: str,
    expected: Arrays,
    found: Arrays,
    pairs: list[tuple[int, int]],
    trees: int,
    matched: int,
) -> FrameParity:
    if not pairs:
        return FrameParity(name, trees, matched)
    left, right = (list(side) for side in zip(*pairs, strict=True))
    gap = {
        key: np.abs(expected[key][left] - found[key][right])
        for key in ("boxes", "scores", "keypoints")
        if key in expected
    }
    points = gap.get("keypoints", np.zeros((1, 1, 3)))
    return FrameParity(
        name,
        trees,
        matched,
        box_px=float(gap["boxes"].max()),
        keypoint_px=float(points[..., :2].max()),
        score=float(gap["scores"].max()),
        keypoint_score=float(points[..., 2].max()),
        mask_iou=_mask_iou(expected["masks"][left], found["masks"][right])
        if "masks" in expected
        else 1.0,
    )


def _mask_iou(first: NDArray[Any], second: NDArray[Any]) -> float:
    """The lowest overlap of paired (N, 28, 28) masks; cells on the very edge do not count."""
    sure = np.abs(first - 0.5) > 1e-3
    a, b = (first > 0.5) & sure, (second > 0.5) & sure
    union = (a | b).sum(axis=(1, 2))
    both = (a & b).sum(axis=(1, 2))
    return float(np.where(union > 0, both / np.maximum(union, 1), 1.0).min())
