"""Match and compare the detections of a file and its model, frame by frame."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import UInt8
from calib import box_iou
from edgetree.export.limits import ParityLimits, limits_of
from edgetree.export.parity import FrameParity

Arrays = Mapping[str, NDArray[Any]]
Detect = Callable[[UInt8], Arrays]

# In float16 and int8, trees with this score are compared. The other side's score may be lower by
# the tolerance.
_MIN_COMPARED_SCORE: Final = 0.5
_SCORE_TOLERANCE: Final = 0.1
UNMATCHED_FRAMES: Final = ("blank", "noise")
"""Frames with many equal scores, whose order is undefined. Only validity is checked there."""
_SCORE_ROUNDING: Final = 1e-3


def compare_frames(
    model: Detect,
    file: Detect,
    frames: Mapping[str, UInt8],
    precision: str,
    threshold: float,
    batch: int = 1,
    unmatched: Sequence[str] = UNMATCHED_FRAMES,
) -> tuple[FrameParity, ...]:
    """Run the model and the file on all frames and compare their detections.

    Args:
        model: Gives the outputs of the model for (B, H, W, 3) or (B, H, W) uint8 images.
        file: Gives those of the file.
        frames: Images by name, without the batch axis.
        precision: `float32`, `float16` or `int8`.
        threshold: Lowest score of a detection.
        batch: Number of images of one call. The last batch is filled up with the first frames.
        unmatched: Names of frames on which only the validity of the outputs is checked.

    Returns:
        The comparison on each frame, in their order.
    """
    names, results = list(frames), []
    for start in range(0, len(names), batch):
        taken = [names[i % len(names)] for i in range(start, start + batch)]
        images = np.stack([frames[name] for name in taken])
        expected, found = model(images), file(images)
        fault = _missing_output(found, expected)
        for row, name in enumerate(taken[: len(names) - start]):
            if fault is not None:
                results.append(FrameParity(name, 0, 0, fault=fault))
                continue
            ours, theirs = _row(expected, row), _row(found, row)
            fault = _invalid_output(theirs, threshold)
            if fault is not None or name in unmatched:
                results.append(FrameParity(name, 0, 0, fault=fault))
                continue
            pair = _valid_rows(ours), _valid_rows(theirs)
            results.append(compare_frame(name, *pair, precision, threshold))
    return tuple(results)


def _row(outputs: Arrays, row: int) -> Arrays:
    return {name: values[row] for name, values in outputs.items()}


def _missing_output(found: Arrays, expected: Arrays) -> str | None:
    for name in expected:
        if name not in found or found[name].shape != expected[name].shape:
            return f"{name} is missing or of another shape"
    return None


def _invalid_output(found: Arrays, threshold: float) -> str | None:
    """Why the outputs of one image are invalid whatever the image, or None."""
    for name, values in found.items():
        if not np.isfinite(values).all():
            return f"{name} is not finite"
    count, rows = int(found["num_detections"]), len(found["boxes"])
    if not 0 <= count <= rows:
        return f"num_detections is {count}, expected 0 to {rows}"
    if any(found[name][count:].any() for name in found if name != "num_detections"):
        return "rows past num_detections are not zero"
    lowest = found["scores"][:count].min(initial=1.0)
    if lowest < threshold - _SCORE_ROUNDING:
        return f"a score is {lowest:.4g}, expected {threshold:g} or more, as the manifest says"
    return None


def _valid_rows(outputs: Arrays) -> Arrays:
    """The outputs of one image without empty rows, and `rows`, the number of all rows."""
    count = int(outputs["num_detections"])
    return {
        name: values[:count] for name, values in outputs.items() if name != "num_detections"
    } | {"rows": np.array(len(outputs["boxes"]))}


def compare_frame(
    name: str, expected: Arrays, found: Arrays, precision: str, threshold: float
) -> FrameParity:
    """Match the trees of one frame by the overlap of their boxes, and compare them.

    Args:
        name: Name of the frame.
        expected: Outputs of the model: `boxes` (N, 4), `scores` (N,), `rows`, the largest
            possible N, and, if the model has them, `keypoints` (N, 5, 3), `keypoint_stds`
            (N, 5, 2) and `masks` (N, 28, 28).
        found: Outputs of the file.
        precision: `float32`, `float16` or `int8`.
        threshold: Lowest score of a detection.
    """
    limits = limits_of(precision)
    overlap = box_iou(expected["boxes"], found["boxes"])
    if precision == "float32":
        tolerance = limits.score or 0.0
        low = [_lowest_certain(side, threshold, tolerance) for side in (expected, found)]
        partner = [threshold, threshold]
    else:
        low = [_MIN_COMPARED_SCORE] * 2
        partner = [_MIN_COMPARED_SCORE - _SCORE_TOLERANCE] * 2
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
    return _differences(name, expected, found, sorted(set(pairs)), trees, matched, limits)


def _lowest_certain(side: Arrays, threshold: float, tolerance: float) -> float:
    """The score from which rounding cannot have added or removed a detection."""
    scores = side["scores"]
    full = len(scores) == int(side["rows"]) and len(scores) > 0
    return float(max(threshold, scores.min() if full else 0.0)) + tolerance


def _differences(
    name: str,
    expected: Arrays,
    found: Arrays,
    pairs: list[tuple[int, int]],
    trees: int,
    matched: int,
    limits: ParityLimits,
) -> FrameParity:
    if not pairs:
        return FrameParity(name, trees, matched)
    left, right = (list(side) for side in zip(*pairs, strict=True))
    gap = {
        key: np.abs(expected[key][left] - found[key][right])
        for key in ("boxes", "scores", "keypoints", "keypoint_stds", "masks")
        if key in expected
    }
    points, masks = (gap.get(key, np.zeros((1, 1, 3))) for key in ("keypoints", "masks"))
    apart_px = points[..., :2].max(-1)
    tied = np.zeros(apart_px.shape, np.bool_)
    if limits.keypoint_px is not None and limits.keypoint_score is not None:
        tied = (apart_px > limits.keypoint_px) & (points[..., 2] <= limits.keypoint_score)
    stds_px = gap.get("keypoint_stds", np.zeros((1, 1, 2))).max(-1)
    iou = np.ones(1)
    values = {"score": gap["scores"]}
    if "keypoints" in gap:
        shift_px = np.hypot(points[..., 0], points[..., 1])
        values["keypoint_score"] = points[..., 2]
        sizes_px = _box_sizes_px(expected["boxes"][left])
        values["keypoint_shift"] = shift_px / sizes_px
        values["keypoint_std"] = stds_px / sizes_px
    if "masks" in gap:
        iou = _mask_iou(expected["masks"][left], found["masks"][right])
        values["mask_probability"] = masks.mean(axis=(1, 2))
        values["mask_iou"] = iou
    return FrameParity(
        name,
        trees,
        matched,
        box_px=float(gap["boxes"].max()),
        keypoint_px=float(apart_px.max()),
        untied_keypoint_px=float(apart_px[~tied].max(initial=0.0)),
        keypoint_ties=int(tied.sum()),
        keypoint_std_px=float(np.where(tied, 0.0, stds_px).max()),
        score=float(gap["scores"].max()),
        keypoint_score=float(points[..., 2].max()),
        mask_probability=float(masks.max()),
        mask_iou=float(iou.min()),
        values={key: tuple(value.ravel().tolist()) for key, value in values.items()},
    )


def _box_sizes_px(boxes: NDArray[Any]) -> NDArray[Any]:
    """(N, 1) square roots of the areas of (N, 4) boxes, at least 1."""
    sides = boxes[:, 2:] - boxes[:, :2]
    size: NDArray[Any] = np.sqrt(np.maximum(sides.prod(axis=1, keepdims=True), 1.0))
    return size


def _mask_iou(first: NDArray[Any], second: NDArray[Any]) -> NDArray[Any]:
    """(N,) IoUs of pairs of (N, 28, 28) masks, without cells that rounding may change."""
    certain = np.abs(first - 0.5) > 1e-3
    a, b = (first > 0.5) & certain, (second > 0.5) & certain
    union = (a | b).sum(axis=(1, 2))
    both = (a & b).sum(axis=(1, 2))
    ious: NDArray[Any] = np.where(union > 0, both / np.maximum(union, 1), 1.0)
    return ious
