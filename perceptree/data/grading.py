"""Which labelled trees count, and which are ignored: neither trees nor background."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from basetree.counts import counted
from basetree.settings import check_value
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.errors import DatasetError
from perceptree.settings.training import CERTAIN


def graded(frames: Sequence[FrameRecord], certain_m: float) -> list[FrameRecord]:
    """Return frames whose trees beyond `certain_m` are ignored; trees without distance count.

    Raises:
        DatasetError: If no tree has a distance.
        SettingsError: If `certain_m` is not over 0.
    """
    check_value("certain distance", certain_m, CERTAIN)
    if not any("distance_m" in tree.truth for frame in frames for tree in frame.trees):
        raise DatasetError(
            f"no tree has a distance_m, expected distances to ignore trees beyond {certain_m:g} m"
        )
    return _with_far(frames, certain_m)


def ungraded(frames: Sequence[FrameRecord]) -> list[FrameRecord]:
    """Return frames whose trees count at any distance."""
    return _with_far(frames, math.inf)


def ignored_note(frames: Sequence[FrameRecord], certain_m: float | None) -> tuple[str, ...]:
    """Tell how many annotations are ignored and why; nothing if all count."""
    trees = [tree for frame in frames for tree in frame.trees if tree.ignored]
    reasons = {
        "by iscrowd": sum(tree.crowd for tree in trees),
        "by ignore": sum(tree.marked and not tree.crowd for tree in trees),
        f"beyond {certain_m:g} m" if certain_m else "": sum(
            tree.far and not (tree.crowd or tree.marked) for tree in trees
        ),
    }
    if not trees and certain_m is None:
        return ()
    shown = [f"{count} {reason}" for reason, count in reasons.items() if count]
    total = sum(len(frame.trees) for frame in frames)
    return (
        f"{len(trees)} of {counted(total, 'annotation')} are ignored: {', '.join(shown) or 'none'}",
    )


def _with_far(frames: Sequence[FrameRecord], limit_m: float) -> list[FrameRecord]:
    def judged(tree: TreeRecord) -> TreeRecord:
        far = tree.truth.get("distance_m", 0.0) > limit_m
        return tree if far == tree.far else replace(tree, far=far)

    return [replace(frame, trees=tuple(map(judged, frame.trees))) for frame in frames]
