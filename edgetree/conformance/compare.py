"""Compare what a program found in a kit's frames with the trees of the kit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from basetree.errors import InputError
from calib import Letterbox
from edgetree.conformance.kit import Kit, KitFrame, read_expected, read_kit
from edgetree.conformance.pairing import Pairing
from edgetree.conformance.results import FoundTree, Results
from edgetree.conformance.tolerances import Tolerance, tolerance_for

_ROUNDING: Final = 1e-3
_KINDS: Final = {
    "score": "",
    "box": " px",
    "keypoint": " px",
    "keypoint score": "",
    "mask": "",
}


@dataclass(frozen=True)
class Quantity:
    """The differences of one kind over all frames, lengths in pixels of the model's input.

    Attributes:
        name: What was compared.
        unit: Its unit with a space before it, or nothing.
        values: Number of values.
        p95: 95 % differ by less.
        largest: The largest difference.
        allowed: The tolerance.
        allowed_share: Share of the box's longer side that is added to it.
        outside: Number of values that differ by more.
        may_be_outside: Number of values that may.
    """

    name: str
    unit: str
    values: int
    p95: float
    largest: float
    allowed: float
    allowed_share: float
    outside: int
    may_be_outside: int


@dataclass(frozen=True)
class Comparison:
    """The result of a check.

    Attributes:
        problems: What differs by more than the tolerance, one line each; empty if it passes.
        quantities: The differences by kind.
        trees: Number of trees in the kit.
        unmatched: Trees that are missing or too many.
        tolerance: The tolerance that was used.
    """

    problems: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    trees: int
    unmatched: int
    tolerance: Tolerance

    @property
    def passed(self) -> bool:
        """Whether the program finds the kit's trees."""
        return not self.problems


def compare_results(folder: Path, results: Results) -> Comparison:
    """Compare a program's results with a kit.

    Trees are paired by the overlap of their boxes. Trees whose score is as near the threshold as
    scores may differ need not be found.

    Raises:
        InputError: The kit cannot be read, or the results are of another model.
    """
    kit, expected = read_kit(folder), read_expected(folder)
    if results.model_sha256 != kit.model_sha256:
        raise InputError(
            f"the results are of the model {results.model_sha256[:12]}..., the kit has"
            f" {kit.model_sha256[:12]}...: expected results of {folder / kit.model}"
        )
    if [frame.name for frame in expected.frames] != [frame.name for frame in kit.frames]:
        raise InputError(
            f"{folder}: expected.json and kit.json have different frames: make it anew"
        )
    tolerance = tolerance_for(kit.precision, expected, results)
    names = [frame.name for frame in results.frames]
    problems = [f"frame {name}: twice" for name in sorted(set(names)) if names.count(name) > 1]
    found = {frame.name: frame.trees for frame in results.frames}
    wanted = {frame.name: frame for frame in expected.frames}
    problems += [f"frame {name}: not in the kit" for name in found if name not in wanted]
    gaps: list[_Gap] = []
    # Frames with a camera are few: what is allowed among all trees would hide that a program does
    # not leave out those beyond reach.
    loose: dict[bool, list[str]] = {False: [], True: []}
    counts = {False: 0, True: 0}
    for frame in kit.frames:
        if frame.name not in found:
            problems.append(f"frame {frame.name}: no result")
            continue
        trees = found[frame.name]
        problems += _invalid(frame.name, trees, kit.score_threshold)
        pairing = Pairing(wanted[frame.name], trees, kit.score_threshold, tolerance.score)
        has_camera = frame.camera is not None
        counts[has_camera] += len(wanted[frame.name].trees)
        loose[has_camera] += pairing.unmatched()
        for ours, theirs in pairing.pairs:
            pair = pairing.candidates[ours], trees[theirs]
            where = f"{frame.name}: tree {ours + 1}"
            problems += _incomplete(where, *pair)
            gaps += _gaps(kit, frame, where, *pair)
    for kind, lines in loose.items():
        if len(lines) > math.floor(tolerance.trees * counts[kind]):
            problems += lines
    quantities = []
    for name in _KINDS:
        quantity, lines = _judge(name, [gap for gap in gaps if gap.kind == name], tolerance)
        quantities += [quantity] if quantity.values else []
        problems += lines
    trees_in_kit = sum(len(frame.trees) for frame in expected.frames)
    unmatched = sum(len(lines) for lines in loose.values())
    return Comparison(tuple(problems), tuple(quantities), trees_in_kit, unmatched, tolerance)


def _invalid(name: str, trees: Sequence[FoundTree], threshold: float) -> Iterator[str]:
    scores = [tree.score for tree in trees]
    if scores != sorted(scores, reverse=True):
        yield f"{name}: the trees are not sorted by descending score"
    if scores and min(scores) < threshold - _ROUNDING:
        yield (
            f"{name}: a tree with score {min(scores):.3f}: expected none below the threshold"
            f" {threshold:g}"
        )


@dataclass(frozen=True)
class _Gap:
    """One difference, what it is of, and the longer side of the box if it is a box's."""

    kind: str
    value: float
    what: str
    side: float = 0.0


def _gaps(
    kit: Kit, frame: KitFrame, here: str, ours: FoundTree, theirs: FoundTree
) -> Iterator[_Gap]:
    """The differences of one tree, lengths in pixels of the model's input."""
    scale = Letterbox.fit(frame.width, frame.height, kit.input_width, kit.input_height).scale
    yield _Gap("score", abs(ours.score - theirs.score), f"{here}: score")
    sides = np.abs(np.subtract(ours.box_px, theirs.box_px)) * np.tile(scale, 2)
    longer = float((np.subtract(ours.box_px[2:], ours.box_px[:2]) * scale).max())
    yield _Gap("box", float(sides.max()), f"{here}: box", longer)
    points, their_points = ours.keypoints_px, theirs.keypoints_px
    if points is not None and their_points is not None:
        shifts = np.subtract(points, their_points) * [*scale, 1.0]
        for index, (x, y, score) in enumerate(shifts.tolist()):
            yield _Gap("keypoint", math.hypot(x, y), f"{here}: keypoint {index + 1}")
            yield _Gap("keypoint score", abs(score), f"{here}: score of keypoint {index + 1}")
    if ours.mask is not None and theirs.mask is not None:
        mean = float(np.abs(np.subtract(ours.mask, theirs.mask)).mean())
        yield _Gap("mask", mean, f"{here}: mask (mean of the probabilities)")


def _incomplete(where: str, ours: FoundTree, theirs: FoundTree) -> Iterator[str]:
    """What only one of two trees has: its keypoints or its mask."""
    for name in ("keypoints_px", "mask"):
        wanted = getattr(ours, name) is not None
        if wanted != (getattr(theirs, name) is not None):
            yield f"{where}: {'no' if wanted else 'a'} {name}: expected it as in expected.json"


def _judge(name: str, gaps: list[_Gap], tolerance: Tolerance) -> tuple[Quantity, list[str]]:
    allowed: dict[str, Any] = {
        "score": tolerance.score,
        "box": tolerance.box_px,
        "keypoint": tolerance.keypoint_px,
        "keypoint score": tolerance.keypoint_score,
        "mask": tolerance.mask,
    }
    values = np.array([gap.value for gap in gaps])
    share = tolerance.box_share if name == "box" else 0.0
    limits = [allowed[name] + share * gap.side for gap in gaps]
    outside = [pair for pair in zip(gaps, limits, strict=True) if not pair[0].value <= pair[1]]
    may = math.floor(tolerance.outside * len(gaps))
    p95, largest = (np.quantile(values, (0.95, 1.0)).tolist()) if gaps else (0.0, 0.0)
    unit = _KINDS[name]
    quantity = Quantity(
        name, unit, len(gaps), p95, largest, allowed[name], share, len(outside), may
    )
    if len(outside) <= may:
        return quantity, []
    return quantity, [
        f"{gap.what} differs by {gap.value:.3g}{unit}: expected at most {limit:.3g}{unit}"
        for gap, limit in outside
    ]
