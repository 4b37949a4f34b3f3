"""Trees found and false trees, with and without the camera that tells which are out of reach.

python -m benchmarks.reach test_set field_test_set --models edge-n-depth models/edge-s.onnx \\
    --result benchmarks/results/reach.json

A detection with a score of `SCORE` and more counts as found where its box overlaps that of a
labelled tree by half, each tree once; the others are false. Labels end at the reach of the models.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.program import finish, note, program
from calib import PinholeCamera, read_depth
from edgetree import TreeDetector
from edgetree.catalogue import find_model
from edgetree.demo.matching import match_boxes
from edgetree.frames.images import read_image
from perceptree.data import FrameRecord, read_dataset

SCORE = 0.5


def count(detector: TreeDetector, frames: list[FrameRecord], with_camera: bool) -> dict[str, Any]:
    """The share of the trees that are found, and false trees a frame."""
    found = false = trees = 0
    for frame in frames:
        assert frame.depth_path is not None
        picture = None if detector.manifest.takes_depth else read_image(frame.image_path)
        camera = PinholeCamera.from_dict(frame.extra["camera"]) if with_camera else None
        detections = detector.detect(picture, read_depth(frame.depth_path), camera)
        boxes_px = np.array([tree.box_px for tree in frame.trees]).reshape(-1, 4)
        right = len(match_boxes(detections.boxes_px, boxes_px))
        found, trees = found + right, trees + len(frame.trees)
        false += len(detections) - right
    return {
        "found_share": round(found / trees, 4),
        "false_per_frame": round(false / len(frames), 4),
    }


def main() -> None:
    """Count for each model and test set."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of datasets, split test")
    parser.add_argument("--models", nargs="+", default=["edge-n-depth"], help="names or files")
    arguments = parser.parse_args()
    models: dict[str, dict[str, Any]] = {}
    for name in arguments.models:
        detector = TreeDetector.load(find_model(name), score_threshold=SCORE)
        for data in arguments.data:
            frames = read_dataset(data, "test").frames
            row = {
                word: count(detector, frames, with_camera)
                for word, with_camera in (("without_camera", False), ("with_camera", True))
            }
            models.setdefault(Path(name).stem, {})[data.name] = row
            note(f"{name} {data.name}", row)
    finish({"score": SCORE, "models": models}, arguments.result)


if __name__ == "__main__":
    main()
