"""Detections as COCO labels, for correction in a labelling tool."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from basetree.files.writing import text_file
from calib import CocoLabels
from edgetree.detections import KEYPOINT_NAMES
from edgetree.frames.pipeline import FrameResult

__all__ = ["labels_file"]

# Lines between keypoints, as indices of KEYPOINT_NAMES: the stem's axis and the diameter.
_SKELETON: Final = ((0, 3), (3, 4), (1, 2))


@contextmanager
def labels_file(
    path: Path, model: str, score_threshold: float
) -> Iterator[Callable[[FrameResult], None]]:
    """Write a COCO file at the end of the block; yields a function that adds a frame to it.

    Args:
        path: the file to write.
        model: name of the model file, for the description in the labels.
        score_threshold: the detector's threshold, likewise.

    Raises:
        InputError: the file cannot be written.
    """
    found = f"trees that {model} finds with a score of at least {score_threshold:g}"
    labels = CocoLabels("tree", KEYPOINT_NAMES, _SKELETON, f"{found}, to be corrected")
    with text_file(path) as stream:
        yield lambda result: _add_frame(labels, result)
        json.dump(labels.to_dict(), stream, allow_nan=False)


def _add_frame(labels: CocoLabels, result: FrameResult) -> None:
    """Add a frame and its trees, under the name of the frame's file."""
    trees = result.trees
    labels.add_image(result.frame.path.name, trees.image_width, trees.image_height)
    for index, score in enumerate(trees.scores):
        points_px = None if trees.keypoints_px is None else trees.keypoints_px[index]
        box_px = trees.boxes_px[index].clip(0, [trees.image_width, trees.image_height] * 2)
        labels.add(box_px, float(score), result.found.mask(index), points_px)
