"""Turns frames into COCO records, with the project's metric fields beside COCO's own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

import calib
from perceptree.simulator.camera import View
from perceptree.simulator.labels import TreeLabel

KEYPOINT_NAMES = ("felling_cut", "diameter_left", "diameter_right", "axis_middle", "axis_top")


@dataclass(frozen=True)
class Frame:
    """One simulated frame: BGR image, measured depth in metres (0: no reading), labels, camera."""

    image: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    labels: list[TreeLabel]
    view: View
    scene_seed: int


def frame_record(frame: Frame, image_id: int) -> dict[str, Any]:
    """The COCO image and its annotations; annotation numbers are given by ``coco_dataset``."""
    height, width = frame.depth_m.shape
    image = {
        "id": image_id,
        "file_name": f"images/{image_id:06d}.jpg",
        "width": width,
        "height": height,
        "depth_file": f"depth/{image_id:06d}.png",
        "depth8_file": f"depth8/{image_id:06d}.png",
        "depth_encoding": calib.DepthEncoding().to_dict(),
        "camera": frame.view.intrinsics.to_dict(),
        "up_camera": [round(float(value), 6) for value in frame.view.up],
        "scene": {"seed": frame.scene_seed, "weather": "clear", "light": "daylight"},
    }
    return {"image": image, "annotations": [_annotation(t, image_id) for t in frame.labels]}


def _annotation(label: TreeLabel, image_id: int) -> dict[str, Any]:
    encoded = coco_mask.encode(np.asfortranarray(label.mask, dtype=np.uint8))
    x0, y0, x1, y1 = label.box_px.tolist()
    keypoints: list[float] = []
    for x, y, flag in label.keypoints.tolist():
        labelled = flag > 0
        keypoints += [round(x - 0.5, 3), round(y - 0.5, 3), int(flag)] if labelled else [0, 0, 0]
    return {
        "image_id": image_id,
        "category_id": 1,
        "bbox": [x0, y0, x1 - x0, y1 - y0],
        "area": int(label.mask.sum()),
        "iscrowd": 0,
        "segmentation": {"size": encoded["size"], "counts": encoded["counts"].decode("ascii")},
        "keypoints": keypoints,
        "num_keypoints": int((label.keypoints[:, 2] > 0).sum()),
        "distance_m": round(label.distance_m, 4),
        "diameter_m": round(label.diameter_m, 5),
        "cut_height_m": round(label.cut_height_m, 4),
        "inclination_deg": round(label.inclination_deg, 3),
        "visible_fraction": round(label.visible_fraction, 4),
        "species": label.species,
    }


def coco_dataset(records: list[dict[str, Any]]) -> dict[str, Any]:
    """One COCO file from frame records, in their order."""
    annotations = [tree for record in records for tree in record["annotations"]]
    return {
        "info": {"description": "Simulated forest frames", "version": "1"},
        "images": [record["image"] for record in records],
        "annotations": [{"id": n, **tree} for n, tree in enumerate(annotations, start=1)],
        "categories": [
            {"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES), "skeleton": []}
        ],
    }
