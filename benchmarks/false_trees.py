"""What the false trees of model files are: stems beyond the labels' reach, or no stems.

python -m benchmarks.false_trees test far_test_set --models edge-n-depth models/edge-s.onnx \\
    --result benchmarks/results/false_trees.json

The frozen test sets label trees to 10 m, so a detection of a stem at 10.1 m counts as false. Here
the frames of one are simulated again, the pictures the same, with labels to `REACH_M`. A
detection with a score of `SCORE` and more that is none of the trees to 10 m is one of these kinds:
`further`: a labelled stem further away (boxes that overlap by half, as in COCO); `again`: a tree
that another detection has found; `loose`: on a labelled stem, but the boxes overlap by less;
`other`: none of these.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from basetree.arrays import Float
from benchmarks.tools.program import finish, note, program
from calib import box_iou, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import find_model
from edgetree.demo.matching import match_boxes
from edgetree.frames.images import read_image
from perceptree.data import FrameRecord, read_dataset
from perceptree.simulator.dataset.frozen import FROZEN_PRESETS
from perceptree.simulator.dataset.generate import generate_dataset
from perceptree.simulator.settings.presets import PRESETS

REACH_M = 13.0
SCORE = 0.5
KINDS = ("further", "again", "loose", "other")
_SAME, _LOOSE = 0.5, 0.2  # overlap of boxes


def labelled_further(preset: str, folder: Path) -> list[FrameRecord]:
    """The frames of a frozen test set with labels to `REACH_M`, simulated where they are missing.

    Args:
        preset: Name of the test set.
        folder: Folder for its frames.
    """
    frozen = PRESETS[preset]
    labels = replace(frozen.settings.labels, reach_m=REACH_M)
    settings = replace(frozen.settings, labels=labels)
    generate_dataset(folder, frozen.frames, settings, frozen.seed, files=frozen.files)
    return read_dataset(folder, "test").frames


def kinds(detections: TreeDetections, frame: FrameRecord, reach_m: float) -> Iterator[str]:
    """The kind of each detection: `right`, or one of `KINDS`.

    Args:
        detections: What a model found, by descending score.
        frame: A frame with labels beyond `reach_m`.
        reach_m: Up to this distance, trees count.
    """
    distance_m = np.array([tree.truth["distance_m"] for tree in frame.trees])
    boxes_px = np.array([tree.box_px for tree in frame.trees]).reshape(-1, 4)
    near_px, far_px = boxes_px[distance_m <= reach_m], boxes_px[distance_m > reach_m]
    right = {match.detection for match in match_boxes(detections.boxes_px, near_px)}
    for row, box_px in enumerate(detections.boxes_px):
        if row in right:
            yield "right"
        elif _overlap(box_px, far_px) >= _SAME:
            yield "further"
        elif _overlap(box_px, near_px) >= _SAME:
            yield "again"
        else:
            yield "loose" if _overlap(box_px, boxes_px) >= _LOOSE else "other"


def _overlap(box_px: Float, others_px: Float) -> float:
    """The largest IoU with one of the others (N, 4)."""
    return float(box_iou(box_px, others_px).max(initial=0.0))


def count(detector: TreeDetector, frames: list[FrameRecord], reach_m: float) -> dict[str, Any]:
    """How many detections a frame are of each of `KINDS`."""
    total: Counter[str] = Counter()
    for frame in frames:
        assert frame.depth_path is not None
        picture = None if detector.manifest.takes_depth else read_image(frame.image_path)
        detections = detector.detect(picture, depth_m=read_depth(frame.depth_path))
        total.update(kinds(detections.above(SCORE), frame, reach_m))
    false = {kind: total[kind] for kind in KINDS}
    return {
        "frames": len(frames),
        "right": total["right"],
        "false": sum(false.values()),
        "kinds": false,
    }


def main() -> None:
    """Count the false trees of models on a frozen test set."""
    parser = program(__doc__)
    parser.add_argument("preset", choices=FROZEN_PRESETS)
    parser.add_argument("folder", type=Path, help="folder for the simulated frames")
    parser.add_argument("--models", nargs="+", default=["edge-n-depth"], help="names or files")
    arguments = parser.parse_args()
    settings = PRESETS[arguments.preset].settings
    frames = labelled_further(arguments.preset, arguments.folder)
    models: dict[str, dict[str, Any]] = {}
    for name in arguments.models:
        detector = TreeDetector.load(find_model(name), score_threshold=SCORE)
        models[Path(name).stem] = count(detector, frames, settings.labels.reach_m)
        note(name, models[Path(name).stem])
    record = {"test_set": arguments.preset, "reach_m": REACH_M, "score": SCORE, "models": models}
    finish(record, arguments.result)


if __name__ == "__main__":
    main()
