"""Convert frames to COCO records, with metric fields in addition to COCO's own."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from pycocotools import mask as coco_mask

import calib
from basetree.arrays import Float
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.simulator.labelling.frame import LabelledFrame
from perceptree.simulator.settings.files import FileSettings

if TYPE_CHECKING:
    from perceptree.simulator.labelling.labels import TreeLabel

_POSE = ("carrier", "height_m", "pitch_deg", "roll_deg")
_DECIMALS = 4
_SETTING_DECIMALS = 6


def frame_record(frame: LabelledFrame, image_id: int, files: FileSettings) -> dict[str, Any]:
    """Make the COCO record of a frame.

    Args:
        frame: The frame.
        image_id: Number of the image, which also names its files.
        files: File formats.

    Returns:
        `image`, a COCO image, and `annotations`, COCO annotations without `id`, which
        `coco_dataset` adds.
    """
    height, width = frame.depth_m.shape
    image = {
        "id": image_id,
        "file_name": f"images/{image_id:06d}.{files.image_format}",
        "width": width,
        "height": height,
        "depth_file": f"depth/{image_id:06d}.png",
        "depth8_file": f"depth8/{image_id:06d}.png",
        "depth_exact_file": f"depth_exact/{image_id:06d}.png",
        "depth_exact_stride_px": frame.exact_stride_px,
        "depth_encoding": calib.DepthEncoding().to_dict(),
        "depth_sensor": _rounded(frame.depth_sensor),
        "camera": frame.view.intrinsics.to_dict(),
        "up_camera": _numbers(frame.view.up, 6),
        "scene": _rounded(asdict(frame.scene)),
        "pose": _rounded({name: getattr(frame.view.pose, name) for name in _POSE}),
    }
    if frame.realism:
        image["realism"] = _rounded(frame.realism)
    annotations = [_annotation(tree, image_id) for tree in frame.labels]
    motion = frame.motion
    if motion is not None:
        image["time_s"] = round(motion.time_s, 6)
        image["pose_world"] = {
            "origin_m": _numbers(motion.origin_m, 6),
            "rotation": [_numbers(row, 9) for row in motion.rotation],
        }
        for tree, record in zip(frame.labels, annotations, strict=True):
            record["stem"] = tree.stem
    return {"image": image, "annotations": annotations}


def _rounded(values: dict[str, Any]) -> dict[str, Any]:
    """Convert numpy scalars to plain numbers, and round floats."""
    plain = {
        key: value.item() if isinstance(value, np.generic) else value
        for key, value in values.items()
    }
    return {
        key: round(value, _SETTING_DECIMALS) if isinstance(value, float) else value
        for key, value in plain.items()
    }


def _numbers(values: Float, decimals: int = _DECIMALS) -> list[float]:
    return [round(float(value), decimals) for value in values]


def _annotation(label: TreeLabel, image_id: int) -> dict[str, Any]:
    encoded = coco_mask.encode(np.asfortranarray(label.mask, dtype=np.uint8))
    x0, y0, x1, y1 = label.box_px.tolist()
    keypoints: list[float] = []
    for xy_px, flag in zip(label.keypoints[:, :2], label.keypoints[:, 2].tolist(), strict=True):
        x, y = calib.image_to_opencv(xy_px).tolist()
        keypoints += [round(x, 3), round(y, 3), int(flag)] if flag > 0 else [0, 0, 0]
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
        "diameter_height_m": round(label.diameter_height_m, 4),
        "diameter_breast_m": round(label.diameter_breast_m, 5),
        "cut_height_m": round(label.cut_height_m, 4),
        "inclination_deg": round(label.inclination_deg, 3),
        "position_m": _numbers(label.position_camera_m),
        "position_world_m": _numbers(label.position_world_m),
        "visible_fraction": round(label.visible_fraction, 4),
        "species": label.species,
        "model": label.model,
    }


def coco_dataset(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Combine frame records into the content of a COCO file, in their order."""
    annotations = [tree for record in records for tree in record["annotations"]]
    return {
        "info": {"description": "Simulated forest frames", "version": "2"},
        "images": [record["image"] for record in records],
        "annotations": [{"id": n, **tree} for n, tree in enumerate(annotations, start=1)],
        "categories": [
            {"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES), "skeleton": []}
        ],
    }
