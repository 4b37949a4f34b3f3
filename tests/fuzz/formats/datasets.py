"""Labels of pictures, and settings of the simulator."""

from __future__ import annotations

import json
from pathlib import Path

from formats.form import Format
from perceptree.data.dataset import read_labels
from perceptree.data.layouts import LabelFile
from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.simulator import SimulatorSettings
from perceptree.simulator.settings.reading import read_settings

_SETTINGS = b'{"stand": {"stems_per_ha": [400, 500]}, "camera": {"mast_share": 0.5}}'


def _coco() -> bytes:
    size = {"width": 8, "height": 4}
    tree = {"image_id": 1, "category_id": 1, "iscrowd": 0, "area": 8}
    tree |= {"bbox": [1, 0, 2, 4], "keypoints": [1, 3, 2] * len(KEYPOINT_NAMES)}
    masks = [
        {"size": [4, 8], "counts": [4, 8, 20]},
        {"size": [4, 8], "counts": "48d0"},
        [[1, 0, 3, 0, 3, 4, 1, 4]],
    ]
    content = {
        "images": [{"id": 1, "file_name": "0.png", **size, "camera": {"fx": 500}}],
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
        "annotations": [
            tree | {"id": number, "segmentation": mask} for number, mask in enumerate(masks)
        ],
    }
    return json.dumps(content).encode()


def _read_coco(path: Path) -> None:
    dataset = read_labels(LabelFile("train", None, False, path, path.parent))
    for frame in dataset.frames:
        for tree in frame.trees:
            if tree.segmentation:
                frame.mask(tree)


FORMATS = {
    "coco.json": Format((_coco(),), _read_coco),
    "settings": Format((_SETTINGS,), lambda path: read_settings(path, SimulatorSettings())),
}
