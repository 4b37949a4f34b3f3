"""Divide frames into splits, with what looks alike or is of one place on the same side."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from basetree.counts import counted
from basetree.errors import SettingsError
from perceptree.data.check.leakage import near_pairs, scene_of
from perceptree.data.check.pictures import Signature, colour_faults
from perceptree.data.coco import FrameRecord
from perceptree.errors import DatasetError

BY = ("likeness", "folder", "name")
DEFAULT_SHARES = {"val": 0.15, "test": 0.15}

_NUMBER_AT_END = re.compile(r"[\W_]*\d+$")


def divide(
    frames: Sequence[FrameRecord],
    shares: Mapping[str, float],
    by: str = "likeness",
    seed: int = 1,
    progress: Callable[[int], object] = lambda frames: None,
) -> dict[str, list[FrameRecord]]:
    """Divide frames at random; groups of frames stay together.

    Frames of one picture or one scene, and pictures that are nearly identical, are always a group.
    `by` adds what else keeps them together: nothing, the folder of the picture, or its name without
    the number at its end, as pictures of one video or place have it.

    Args:
        frames: The frames.
        shares: Share of the frames for "val" and "test", each at least 0, together under 1; the
            rest is "train".
        by: One of `BY`.
        seed: Of the random order of the groups.
        progress: Called with the number of further frames done.

    Returns:
        Frames of each split with a share over 0, in their order.

    Raises:
        SettingsError: If a share, `by` or the seed is wrong.
        DatasetError: If there are fewer groups than splits.
    """
    _check(shares, by)
    check_seed(seed)
    wanted = {"train": 1.0 - sum(shares.values()), **shares}
    wanted = {split: share for split, share in wanted.items() if share > 0}
    group_of = _groups(frames, by, progress)
    sizes = Counter(group_of)
    if len(sizes) < len(wanted):
        raise DatasetError(
            f"{counted(len(frames), 'picture')} form {counted(len(sizes), 'group')} that"
            " belong together, expected at"
            f" least {len(wanted)}, for {', '.join(wanted)}"
            f"{' (--test 0 makes no test split)' * ('test' in wanted)}"
        )
    split_of = _assign(sizes, wanted, seed)
    found: dict[str, list[FrameRecord]] = {split: [] for split in wanted}
    for frame, group in zip(frames, group_of, strict=True):
        found[split_of[group]].append(frame)
    return found


def check_seed(seed: int) -> None:
    """Raise SettingsError for a seed below 0."""
    if seed < 0:
        raise SettingsError(f"--seed is {seed}: expected at least 0")


def _check(shares: Mapping[str, float], by: str) -> None:
    for split, share in shares.items():
        if not 0 <= share < 1:
            raise SettingsError(f"--{split} is {share}: expected a share from 0 to below 1")
    if not 0 < sum(shares.values()) < 1:
        raise SettingsError(
            f"the shares of {' and '.join(shares)} are {sum(shares.values()):g} together: expected"
            " more than 0 and less than 1"
        )
    if by not in BY:
        raise SettingsError(f"--by is {by!r}: expected one of {', '.join(BY)}")


def _groups(frames: Sequence[FrameRecord], by: str, progress: Callable[[int], object]) -> list[int]:
    """The number of the group of each frame: the place of its first frame."""
    first = list(range(len(frames)))

    def root(place: int) -> int:
        while first[place] != place:
            first[place] = first[first[place]]
            place = first[place]
        return place

    for one, other in (*_same_keys(frames, by), *_alike(frames, progress)):
        low, high = sorted((root(one), root(other)))
        first[high] = low
    return [root(place) for place in range(len(frames))]


def _same_keys(frames: Sequence[FrameRecord], by: str) -> Iterator[tuple[int, int]]:
    """Yield (first place, place) of frames with the same picture, scene, folder or name."""
    seen: dict[Hashable, int] = {}
    for place, frame in enumerate(frames):
        scene = scene_of(frame)
        keys: list[Hashable] = [("picture", frame.image_path)]
        keys += [] if scene is None else [("scene", scene)]
        if by == "folder":
            keys.append((by, frame.image_path.parent))
        elif by == "name":
            keys.append((by, frame.image_path.parent, _name_without_number(frame.image_path)))
        for key in keys:
            yield seen.setdefault(key, place), place


def _name_without_number(path: Path) -> str:
    return _NUMBER_AT_END.sub("", path.stem)


def _alike(
    frames: Sequence[FrameRecord], progress: Callable[[int], object]
) -> Iterator[tuple[int, int]]:
    """Yield places of frames whose pictures are nearly identical; unreadable ones are like none."""
    signatures: list[Signature] = []
    readable: list[int] = []
    with ThreadPoolExecutor() as pool:
        for place, (_, signature, _) in enumerate(pool.map(colour_faults, frames)):
            progress(1)
            if signature is not None:
                signatures.append(signature)
                readable.append(place)
    for one, other in near_pairs(signatures):
        yield readable[one], readable[other]


def _assign(sizes: Mapping[int, int], wanted: Mapping[str, float], seed: int) -> dict[int, str]:
    """Give each group a split: the one that lacks most of its share; large groups come first."""
    groups = list(sizes)
    np.random.default_rng(seed).shuffle(groups)
    groups.sort(key=lambda group: -sizes[group])
    total = sum(sizes.values())
    lacking = {split: share * total for split, share in wanted.items()}
    split_of: dict[int, str] = {}
    empty = list(wanted)
    for place, group in enumerate(groups):
        must = len(groups) - place <= len(empty)  # so that no split stays empty
        split = max(empty if must else lacking, key=lacking.__getitem__)
        lacking[split] -= sizes[group]
        split_of[group] = split
        if split in empty:
            empty.remove(split)
    return split_of
