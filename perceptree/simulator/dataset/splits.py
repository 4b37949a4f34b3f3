"""Which split a scene belongs to."""

from __future__ import annotations

from perceptree.simulator.settings import SplitSettings

SPLITS = ("train", "val", "test")
_MIN_SHARE = 1e-9


def split_shares(settings: SplitSettings) -> dict[str, float]:
    """Share of the scenes of every split that has any, in the order of SPLITS."""
    shares = dict(
        zip(SPLITS, (1 - settings.val - settings.test, settings.val, settings.test), strict=True)
    )
    return {split: share for split, share in shares.items() if share > _MIN_SHARE}


def assign_splits(scenes: int, settings: SplitSettings) -> list[str]:
    """The split of every scene.

    The first scenes go to one split each, so that none is empty; every scene after them goes to
    the split that lacks most. A scene's split depends on the scenes before it alone: a dataset
    that is extended keeps its splits, and no model is tested on what it was trained on.
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
