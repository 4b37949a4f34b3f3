"""Simulated drives with the detections and measurements of a network, for `tracking.py`."""

from __future__ import annotations

import pickle
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.drives import drive_records, frame_without_pixels
from calib import PinholeCamera, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.demo.matching import match_boxes
from edgetree.frames.frame import Frame
from edgetree.measure import EXACT_RIG, TreeMeasurement, measure_trees


@dataclass(frozen=True)
class DriveFrame:
    """A frame with what was found in it and what is true.

    Attributes:
        data: Folder of the dataset.
        image: Keys of the frame in the labels.
        labels: Its labelled trees.
        boxes: (L, 4) their boxes, xyxy px.
        trees: What the network found.
        measurements: One per found tree.
        label_of: Index of the labelled tree for each found one that matches one.
    """

    data: Path
    image: dict[str, Any]
    labels: list[dict[str, Any]]
    boxes: np.ndarray
    trees: TreeDetections
    measurements: list[TreeMeasurement]
    label_of: dict[int, int]

    def live(self, pose: bool, vertical: bool, depth: bool = False) -> Frame:
        """The frame as a source gives it, with pose, vertical and depth or without them."""
        known = frame_without_pixels(self.image)
        return replace(
            known,
            depth_m=read_depth(self.data / self.image["depth_file"]) if depth else None,
            up_camera=known.up_camera if vertical else None,
            pose=known.pose if pose else None,
        )


def load_drives(
    datasets: list[Path], detector: TreeDetector, cache: Path | None
) -> dict[str, list[DriveFrame]]:
    """All finished drives of datasets that show stems, by the names of dataset and scene.

    Args:
        datasets: Folders of the datasets.
        detector: Network for depth images.
        cache: Folder for detections and measurements, so that they are made once.
    """
    drives = {}
    scenes = (scene for data in datasets for scene in sorted((data / "scenes").glob("*.json")))
    for scene in scenes:
        data = scene.parent.parent
        name = f"{data.resolve().name}-{scene.stem}"
        kept = None if cache is None else cache / f"{name}.pickle"
        if kept is not None and kept.exists():
            frames = pickle.loads(kept.read_bytes())
        else:
            frames = [_drive_frame(data, record, detector) for record in drive_records(scene)]
            if kept is not None:
                kept.write_bytes(pickle.dumps(frames))
        if any(frame.labels for frame in frames):
            drives[name] = frames
    return drives


def _drive_frame(data: Path, record: dict[str, Any], detector: TreeDetector) -> DriveFrame:
    image, labels = record["image"], record["annotations"]
    depth_m = read_depth(data / image["depth_file"])
    trees = detector.detect(depth_m)
    camera = PinholeCamera.from_dict(image["camera"])
    measurements = measure_trees(
        trees, depth_m, camera, up_camera=image["up_camera"], rig_uncertainty=EXACT_RIG
    )
    boxes = np.array([label["bbox"] for label in labels], np.float64).reshape(-1, 4)
    boxes[:, 2:] += boxes[:, :2]
    matches = match_boxes(trees.boxes_px, boxes) if len(trees) and len(labels) else []
    label_of = {match.detection: match.truth for match in matches}
    return DriveFrame(data, image, labels, boxes, trees, measurements, label_of)
