"""Frames of simulated drives, as their labels describe them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from calib import PinholeCamera, RigidTransform
from edgetree.frames.frame import Frame, stream_frame


def drive_records(scene: Path) -> list[dict[str, Any]]:
    """Image and labels of each frame of a drive, in the order of time.

    Args:
        scene: File of the drive in the folder `scenes` of its dataset.
    """
    records: list[dict[str, Any]] = json.loads(scene.read_text("utf-8"))
    return sorted(records, key=lambda record: float(record["image"]["time_s"]))


def frame_without_pixels(image: dict[str, Any]) -> Frame:
    """A frame with what a machine knows of it, from the keys of its image in the labels."""
    pose = image["pose_world"]
    return stream_frame(
        number=image["id"],
        time_s=image["time_s"],
        image=None,
        camera=PinholeCamera.from_dict(image["camera"]),
        up_camera=np.array(image["up_camera"]),
        # The rows of the label's rotation are the camera's axes in the world.
        pose=RigidTransform(np.transpose(pose["rotation"]), pose["origin_m"]),
    )
