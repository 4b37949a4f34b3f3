"""Write frames as YOLO trainers read them: `data.yaml`, pictures, and a text file for each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from basetree.arrays import Float64
from basetree.files.writing import write_text
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.exchange.outlines import HOLES, SMALL_PARTS, joined, outlines
from perceptree.data.exchange.places import Places
from perceptree.data.exchange.yolo import FOLDER_OF_NONE
from perceptree.keypoints import KEYPOINT_FLIP_PAIRS, KEYPOINT_NAMES

_DIGITS = 6

Splits = Mapping[str | None, Sequence[FrameRecord]]


def write_yolo(out: Path, splits: Splits, keypoints: bool) -> list[str]:
    """Write a dataset of one class, "tree".

    Args:
        out: The new folder.
        splits: Frames of each split; None for frames without a split.
        keypoints: Whether boxes with keypoints are written; else polygons.

    Returns:
        Messages for the user about what the form cannot hold, and pictures that do not fit.
    """
    places = Places(out, [frame for frames in splits.values() for frame in frames])
    ignored, without, unheld, with_metres = 0, 0, 0, 0
    several, holes, parts = 0, 0, 0
    for split, frames in splits.items():
        folder = split or FOLDER_OF_NONE
        for frame in frames:
            places.copy(frame.image_path, "images", folder)
            counted = [tree for tree in frame.trees if not tree.ignored]
            ignored += len(frame.trees) - len(counted)
            if keypoints:
                lines = [_pose(frame, tree) for tree in counted]
            else:
                traced = [outlines(frame, tree) for tree in counted]
                lines = [_polygon(frame, one.parts) for one in traced if one.parts]
                several += sum(len(one.parts) > 1 for one in traced)
                holes += sum(one.fills_holes for one in traced)
                parts += sum(one.drops_parts for one in traced)
            without += len(counted) - len(lines)
            held = [
                tree.segmentation is not None if keypoints else tree.keypoints.any()
                for tree in counted
            ]
            unheld += sum(map(bool, held))
            with_metres += frame.has_depth or any(tree.truth for tree in counted)
            path = out / "labels" / folder / f"{places.stem(frame)}.txt"
            path.parent.mkdir(parents=True, exist_ok=True)
            write_text(path, "".join(f"{line}\n" for line in lines))
    write_text(out / "data.yaml", "\n".join(_settings(splits, keypoints)) + "\n")
    lost = "masks" if keypoints else "keypoints"
    messages = {
        "left out: {} ignored regions; a YOLO label file has none, they become background": ignored,
        "left out: {} trees without a mask": without,
        f"left out: the {lost} of {{}} trees, for which this form has no place": unheld,
        "left out: depth and metric values of {} frames, for which YOLO has no place": with_metres,
        "{} masks of several parts are joined to one outline by lines without width": several,
        HOLES: holes,
        SMALL_PARTS: parts,
    }
    return [text.format(count) for text, count in messages.items() if count] + places.notes()


def _settings(splits: Splits, keypoints: bool) -> Iterator[str]:
    for split in splits:
        yield f"{split or 'train'}: images/{split or FOLDER_OF_NONE}"
    if "val" not in splits:  # which those trainers demand
        yield f"val: images/{'train' if 'train' in splits else next(iter(splits)) or 'all'}"
    yield "names:"
    yield "  0: tree"
    if keypoints:
        flipped = list(range(len(KEYPOINT_NAMES)))
        for first, second in KEYPOINT_FLIP_PAIRS:
            flipped[first], flipped[second] = second, first
        yield f"kpt_shape: [{len(KEYPOINT_NAMES)}, 3]"
        yield f"flip_idx: {flipped}"
        yield "kpt_names:"
        yield f"  0: [{', '.join(KEYPOINT_NAMES)}]"


def _pose(frame: FrameRecord, tree: TreeRecord) -> str:
    size = np.array([frame.width, frame.height], np.float64)
    low, high = (np.clip(tree.box_px[corner].reshape(2) / size, 0, 1) for corner in _CORNERS)
    box = _numbers(np.concatenate([(low + high) / 2, high - low]))
    points = [f"{_numbers(point[:2] / size)} {int(point[2])}" for point in tree.keypoints]
    return " ".join(["0", box, *points])


_CORNERS = (slice(0, 2), slice(2, 4))


def _polygon(frame: FrameRecord, parts: Sequence[Float64]) -> str:
    """A line with the outlines (N, 2) of a tree in px, at least one."""
    shares = np.clip(joined(parts) / np.array([frame.width, frame.height]), 0, 1)
    return f"0 {_numbers(shares.reshape(-1))}"


def _numbers(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> str:
    return " ".join(f"{value:.{_DIGITS}g}" for value in values)
