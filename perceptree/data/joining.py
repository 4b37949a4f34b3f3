"""Join the keypoints of one label file to the annotations of another."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path

import numpy as np

from basetree.arrays import Float64
from basetree.counts import counted
from perceptree.data.content import load
from perceptree.data.entries import Entry, EntryError, are_numbers
from perceptree.data.pictures import path_parts
from perceptree.data.standard import Report, Standard
from perceptree.data.tally import Tally
from perceptree.errors import DatasetError

_LEAST_INSIDE = 0.5
_BORDER_PX = 1.0
_MOST_PAIRS = 4_000_000  # in one picture


def join_keypoints(entries: Standard, path: Path, report: Report, tally: Tally) -> str:
    """Give annotations the keypoints of another file.

    Images belong together by their file names, annotations if at least half of the labelled
    keypoints lie in the other's box; of several boxes that is the one with the largest overlap.

    Args:
        entries: The entries of the file with masks or boxes, changed in place.
        path: The file with keypoints.
        report: Called with each invalid entry of the second file.
        tally: Counts keypoints without a box.

    Returns:
        A message for the user.

    Raises:
        DatasetError: If the second file is no COCO file or shares no picture with the first.
    """
    try:
        others = Standard(load(path), report)
    except DatasetError as error:
        raise DatasetError(f"{path.name}: {error}") from error
    images = {tuple(path_parts(str(one.get("file_name")))): one["id"] for one in entries.images}
    image_of = {
        one["id"]: images.get(tuple(path_parts(str(one.get("file_name"))))) for one in others.images
    }
    if not any(image is not None for image in image_of.values()):
        raise DatasetError(f"shares no picture with {path.name}, expected the same file names")
    boxes = _by_image(entries.annotations, {one["id"]: one["id"] for one in entries.images})
    points = _by_image([one for one in others.annotations if _is_pointed(one, report)], image_of)
    joined = 0
    for image, found in points.items():
        matched = _match(found, boxes.get(image, []))
        for place, one in enumerate(found):
            if place in matched:
                matched[place]["keypoints"] = one["keypoints"]
            else:
                tally.left_out.append(("keypoints_alone", one["id"]))
        joined += len(matched)
    _name_keypoints(entries.categories, others.categories)
    total = len(entries.annotations)
    return (
        f"keypoints of {path.name} are joined to {joined} of {counted(total, 'annotation')}"
        " by their places"
    )


def _by_image(annotations: list[Entry], image_of: dict[int, int | None]) -> dict[int, list[Entry]]:
    found: dict[int, list[Entry]] = defaultdict(list)
    for annotation in annotations:
        image = image_of.get(annotation["image_id"])
        if image is not None:
            found[image].append(annotation)
    return found


def _is_pointed(annotation: Entry, report: Report) -> bool:
    """Whether an annotation has a labelled keypoint; reports keypoints that are none."""
    listed = annotation.get("keypoints")
    if not listed:
        return False
    if not are_numbers(listed) or len(listed) % 3:
        report(EntryError(annotation, "annotation", "keypoints", "x, y, flag of each"))
        return False
    return any(listed[2::3])


def _match(points: list[Entry], boxed: list[Entry]) -> dict[int, Entry]:
    """Return the annotation with a box of each of the keypoints, by their place in the list."""
    usable = [one for one in boxed if are_numbers(one.get("bbox")) and len(one["bbox"]) == 4]
    if len(points) * len(usable) > _MOST_PAIRS:
        raise DatasetError(
            f"a picture has {len(points)} annotations with keypoints and {len(usable)} with boxes,"
            f" expected at most {_MOST_PAIRS} pairs"
        )
    if not usable:
        return {}
    boxes = np.array([one["bbox"] for one in usable], np.float64)
    boxes[:, 2:] += boxes[:, :2]
    likeness = np.array([_likeness(one["keypoints"], boxes) for one in points])
    matched: dict[int, Entry] = {}
    taken: set[int] = set()
    for flat in np.argsort(-likeness, axis=None, kind="stable"):
        place, box = divmod(int(flat), len(usable))
        if likeness[place, box] < _LEAST_INSIDE:
            break
        if place not in matched and box not in taken:
            matched[place] = usable[box]
            taken.add(box)
    return matched


def _likeness(keypoints: list[float], boxes: Float64) -> Float64:
    """How well keypoints fit boxes, (N, 4) xyxy px.

    Returns:
        (N,) share of the labelled keypoints in the box, plus the overlap of the box with the one
        around them as intersection over union; 0 if less than half of them are inside.
    """
    listed = np.array(keypoints, np.float64).reshape(-1, 3)
    points = listed[listed[:, 2] > 0, :2]
    if not len(points):
        return np.zeros(len(boxes))
    inside = (
        ((points >= boxes[:, None, :2] - _BORDER_PX) & (points <= boxes[:, None, 2:] + _BORDER_PX))
        .all(-1)
        .mean(-1)
    )
    low, high = points.min(0), points.max(0)
    sides = np.minimum(boxes[:, 2:], high) - np.maximum(boxes[:, :2], low)
    shared = np.clip(sides, 0, None).prod(-1)
    union = (boxes[:, 2:] - boxes[:, :2]).prod(-1) + (high - low).prod() - shared
    overlap = np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)
    return np.where(inside >= _LEAST_INSIDE, inside + overlap, 0.0)


def _name_keypoints(categories: list[Entry], others: list[Entry]) -> None:
    """Give categories the names of the keypoints of the other file."""
    named = [one for one in others if one.get("keypoints")]
    for category in categories:
        same = [one for one in named if one.get("name") == category.get("name")]
        if chosen := same or (named if len(named) == 1 else []):
            category["keypoints"] = chosen[0]["keypoints"]
