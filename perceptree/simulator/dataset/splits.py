"""Assign scenes to the splits of a dataset."""

from __future__ import annotations

from perceptree.simulator.settings import SplitSettings

SPLITS = ("train", "val", "test")  # as `perceptree.data.coco` has them, which needs torch

_MIN_SHARE = 1e-9


def split_shares(settings: SplitSettings) -> dict[str, float]:
    """Fraction of the scenes by split, in the order of SPLITS, without empty splits."""
    shares = dict(
        zip(SPLITS, (1 - settings.val - settings.test, settings.val, settings.test), strict=True)
    )
    return {split: share for split, share in shares.items() if share > _MIN_SHARE}


def assign_splits(scenes: int, settings: SplitSettings) -> list[str]:
    """Assign every scene to a split.

    The first scenes go to different splits, so that none is empty. Each later scene goes to the
    split with the largest deficit. A scene's split depends only on its number, so that an extended
    dataset keeps its splits, and no training scene becomes a test scene.

    Args:
        scenes: Number of scenes.
        settings: Fractions of the splits.

    Returns:
        Name of the split of each scene.
    """
    shares = split_shares(settings)
    counts = dict.fromkeys(shares, 0)
    assigned = []
    for scene in range(scenes):
        empty = [split for split, count in counts.items() if count == 0]
        lacking = {split: share * (scene + 1) - counts[split] for split, share in shares.items()}
        split = empty[0] if empty else max(lacking, key=lacking.__getitem__)
        counts[split] += 1
        assigned.append(split)
    return assigned
