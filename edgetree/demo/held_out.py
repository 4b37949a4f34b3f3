"""Frames of a dataset on disk as sample frames: pictures, depth, camera, truth."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from calib import PinholeCamera
from edgetree.errors import InputError
from edgetree.samples import SampleFrame, SampleTree

__all__ = ["held_out_frames"]


def held_out_frames(data: Path, split: str, count: int) -> list[SampleFrame]:
    """Up to `count` frames of a simulated dataset's split, spread evenly over it.

    Args:
        data: folder with `<split>_RGB.json` in COCO's format and the simulator's own fields.
        split: `train`, `val` or `test`.
        count: how many frames to take.

    Raises:
        InputError: the file is missing, or lacks what the simulator writes.
    """
    path = data / f"{split}_RGB.json"
    try:
        coco = json.loads(path.read_text(encoding="utf-8"))
        images = coco["images"]
        picked = np.linspace(0, len(images) - 1, min(count, len(images))).round().astype(int)
        return [_frame(data, images[index], coco["annotations"]) for index in picked]
    except (OSError, ValueError, KeyError) as error:
        raise InputError(
            f"{path} cannot be used ({error!r}): expected a dataset of the simulator"
        ) from error


def _frame(data: Path, image: dict[str, Any], annotations: list[dict[str, Any]]) -> SampleFrame:
    return SampleFrame(
        name=Path(image["file_name"]).stem,
        image_path=data / image["file_name"],
        depth_path=data / image["depth_file"],
        camera=PinholeCamera.from_dict(image["camera"]),
        up_camera=np.array(image["up_camera"], dtype=np.float64),
        trees=tuple(_tree(a) for a in annotations if a["image_id"] == image["id"]),
    )


def _tree(annotation: dict[str, Any]) -> SampleTree:
    """One annotation; COCO's keypoints are pixel indices, ours continuous: half a pixel more."""
    x, y, width, height = annotation["bbox"]
    keypoints = np.array(annotation["keypoints"], dtype=np.float32).reshape(-1, 3)
    keypoints[keypoints[:, 2] > 0, :2] += 0.5
    return SampleTree(
        box_px=np.array([x, y, x + width, y + height], dtype=np.float32),
        keypoints_px=keypoints,
        diameter_m=float(annotation["diameter_m"]),
        cut_height_m=float(annotation["cut_height_m"]),
        distance_m=float(annotation["distance_m"]),
        inclination_deg=float(annotation["inclination_deg"]),
        visible_fraction=float(annotation["visible_fraction"]),
        species=str(annotation["species"]),
    )
