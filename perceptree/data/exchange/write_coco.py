"""Write frames as COCO, with everything that the records hold."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from basetree.files.writing import write_text
from calib import image_to_opencv
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.exchange.places import Places
from perceptree.errors import DatasetError
from perceptree.keypoints import KEYPOINT_NAMES

_DECIMALS = 3


def write_coco(out: Path, splits: Mapping[str | None, Sequence[FrameRecord]]) -> list[str]:
    """Write `SPLIT_RGB.json` for each split, `annotations.json` for frames without one.

    Returns:
        Messages for the user about pictures that do not fit their labels.
    """
    places = Places(out, [frame for frames in splits.values() for frame in frames])
    for split, frames in splits.items():
        content: dict[str, Any] = {
            "images": [_image(number, frame, places) for number, frame in enumerate(frames, 1)],
            "annotations": [],
            "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
        }
        for number, frame in enumerate(frames, 1):
            for tree in frame.trees:
                place = len(content["annotations"]) + 1
                content["annotations"].append(_annotation(place, number, tree, frame))
        name = "annotations.json" if split is None else f"{split}_RGB.json"
        write_text(out / name, json.dumps(content))
    return places.notes()


def _image(number: int, frame: FrameRecord, places: Places) -> dict[str, Any]:
    entry = {
        "id": number,
        "file_name": places.copy(frame.image_path, "images"),
        "width": frame.width,
        "height": frame.height,
        **frame.extra,
    }
    files = {
        "depth_file": frame.depth_path,
        "depth8_file": frame.depth8_path,
        "depth_exact_file": frame.exact_path,
    }
    for field, path in files.items():
        if path is not None:
            entry[field] = places.copy(path, field.removesuffix("_file"))
    if frame.exact_path is not None:
        entry["depth_exact_stride_px"] = frame.exact_stride_px
    return entry


def _annotation(number: int, image: int, tree: TreeRecord, frame: FrameRecord) -> dict[str, Any]:
    x0, y0, x1, y1 = (round(float(value), _DECIMALS) for value in tree.box_px)
    points = np.array(tree.keypoints, np.float64)
    labelled = points[:, 2] > 0
    points[labelled, :2] = image_to_opencv(points[labelled, :2])
    wide, high = round(x1 - x0, _DECIMALS), round(y1 - y0, _DECIMALS)
    area_px = _mask_area_px(frame, tree)
    entry: dict[str, Any] = {
        "id": number,
        "image_id": image,
        "category_id": 1,
        "bbox": [x0, y0, wide, high],
        "area": round(wide * high, _DECIMALS) if area_px is None else area_px,
        "iscrowd": int(tree.crowd),
        "keypoints": [
            value
            for x, y, flag in points.tolist()
            for value in (round(x, _DECIMALS), round(y, _DECIMALS), int(flag))
        ],
        "num_keypoints": int(labelled.sum()),
        **tree.truth,
        **tree.extra,
    }
    if tree.segmentation is not None:
        entry["segmentation"] = tree.segmentation
    if tree.marked:
        entry["ignore"] = 1
    if tree.species is not None:
        entry["species"] = tree.species
    return entry


def _mask_area_px(frame: FrameRecord, tree: TreeRecord) -> int | None:
    """Pixels of a tree's mask, as COCO means the area; None without a mask that can be read."""
    if tree.segmentation is None:
        return None
    try:
        return int(frame.mask(tree).sum())
    except DatasetError:  # the run lengths are broken, which `perceptree data check` tells
        return None
