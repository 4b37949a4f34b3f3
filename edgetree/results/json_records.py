"""Results as JSON values. The unit of each number is in its key or its parent's key."""

from __future__ import annotations

import json
from typing import Any, Final, TextIO

from calib import encode_rle
from edgetree.detections import KEYPOINT_NAMES, UnlikeTraining
from edgetree.frames.pipeline import FrameResult

__all__ = ["FRAME_SCHEMA", "frame_record", "write_json_line"]

FRAME_SCHEMA: Final = "edgetree.frame/1"


def frame_record(result: FrameResult) -> dict[str, Any]:
    """A frame's result as a JSON object.

    Pixel coordinates are continuous, with (0, 0) at the outer corner of the first pixel. `tree` is
    the number in tables and pictures, `box_px` is x0, y0, x1, y1, a keypoint is x, y, score, and
    `mask_rle` is a compressed COCO RLE mask of the image's size. `metres` is the measurement, or
    null if there is none; `metres_need` then says which option is missing. `unlike_training` is the
    statistic that tells that the image looks unlike the training pictures, with advice; it is there
    only then.
    """
    trees = result.trees
    record: dict[str, Any] = {
        "schema": FRAME_SCHEMA,
        "frame": result.frame.name,
        "path": str(result.frame.path),
        "image_width_px": trees.image_width,
        "image_height_px": trees.image_height,
        "detect_ms": round(result.detect_ms, 1),
        "trees": [_tree_record(result, index) for index in range(len(trees))],
    }
    if result.frame.time_s is not None:
        record["time_s"] = result.frame.time_s
    if trees.unlike is not None:
        record["unlike_training"] = _unlike_record(trees.unlike)
    return record


def _unlike_record(unlike: UnlikeTraining) -> dict[str, Any]:
    return {
        "statistic": unlike.statistic,
        "value": _rounded(unlike.value, 3),
        "usual": [unlike.low, unlike.high],
        "unit": unlike.unit,
        "advice": unlike.advice,
    }


def _tree_record(result: FrameResult, index: int) -> dict[str, Any]:
    trees = result.trees
    record: dict[str, Any] = {
        "tree": result.found.numbers[index],
        "score": _rounded(trees.scores[index], 4),
        "box_px": [_rounded(value, 2) for value in trees.boxes_px[index]],
    }
    if trees.keypoints_px is not None:
        record["keypoints_px"] = {
            name: [_rounded(x, 2), _rounded(y, 2), _rounded(score, 4)]
            for name, (x, y, score) in zip(KEYPOINT_NAMES, trees.keypoints_px[index], strict=True)
        }
    mask = result.found.mask(index)
    if mask is not None:
        record["mask_rle"] = encode_rle(mask)
    record["metres"] = None
    if result.measurements is not None:
        record["metres"] = result.measurements[index].to_dict()
    else:
        record["metres_need"] = result.metres_need
    return record


def _rounded(value: float, digits: int) -> float:
    return round(float(value), digits)


def write_json_line(stream: TextIO, record: dict[str, Any]) -> None:
    """Write one record as one line and flush the stream, for programs that read along."""
    stream.write(json.dumps(record, allow_nan=False) + "\n")
    stream.flush()
