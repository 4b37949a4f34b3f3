"""How well checkpoints do on real pictures and on simulated frames, in one table.

python -m benchmarks.transfer PICTURES/instances.json test_set field_test_set \\
    --runs frozen=RUN/best.safetensors average=FILE ... --result benchmarks/results/transfer.json

Real pictures: AP50, recall at a score of 0.5, and recall at the lowest score with a precision
of at least 0.8, in float32. Simulated frames: AP of boxes, masks and keypoints on every N-th
frame of both frozen test sets, under the paper's rule (trees to 10 m). Rows of runs that the file
already holds are replaced, other rows stay.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import torch

from basetree.files.reading import read_image
from basetree.files.writing import write_text
from benchmarks.real_pictures import SHOWN_SCORE, compare, ground_truth
from benchmarks.tools.program import program, read_record
from calib import Letterbox
from perceptree.data import FrameStore, read_dataset
from perceptree.evaluation import evaluate, predict_with
from perceptree.models import TreeRCNN, load_checkpoint

LEAST_SCORE = 0.02
PRECISION = 0.8


def detections(model: TreeRCNN, folder: Path, image: dict[str, Any]) -> list[dict[str, Any]]:
    """What a model finds in a picture, in COCO's format."""
    picture = np.asarray(read_image(folder / image["file_name"]), np.uint8)
    height, width = picture.shape[:2]
    box = Letterbox.fit(width, height, model.spec.width, model.spec.height)
    with torch.inference_mode():
        found = model.detect(torch.from_numpy(box.apply(picture, model.spec.pad_value))[None])
    count = int(found.num_detections[0])
    corners = found.boxes[0, :count].numpy().astype(float).reshape(-1, 2)
    boxes = box.to_source(corners).reshape(-1, 4)
    boxes[:, [0, 2]] = boxes[:, [0, 2]].clip(0, width)
    boxes[:, [1, 3]] = boxes[:, [1, 3]].clip(0, height)
    boxes[:, 2:] -= boxes[:, :2]
    return [
        {"image_id": image["id"], "category_id": 1, "bbox": one, "score": score}
        for one, score in zip(boxes.tolist(), found.scores[0, :count].tolist(), strict=True)
        if score >= LEAST_SCORE
    ]


def on_pictures(model: TreeRCNN, labels: Path) -> dict[str, Any]:
    """AP50, and recall and precision at two scores."""
    truth = ground_truth(labels)
    found = [
        one
        for image in truth.dataset["images"]
        for one in detections(model, labels.parent / "images", image)
    ]
    matched = compare(truth, found)
    recall = np.cumsum(matched.right) / matched.stems
    precision = np.cumsum(matched.right) / np.arange(1, len(matched.right) + 1)
    exact = np.flatnonzero(precision >= PRECISION)
    shown = int((matched.scores >= SHOWN_SCORE).sum())
    return {
        "AP50": matched.ap50,
        "stems": matched.stems,
        "recall at 0.5": round(float(recall[shown - 1]), 3) if shown else 0.0,
        "precision at 0.5": round(float(precision[shown - 1]), 3) if shown else None,
        "recall at a precision of 0.8": round(float(recall[exact[-1]]), 3) if len(exact) else 0,
        "score there": round(float(matched.scores[exact[-1]]), 3) if len(exact) else None,
    }


def on_frames(model: TreeRCNN, folder: Path, every: int) -> dict[str, float]:
    """AP of boxes, masks and keypoints on every `every`-th frame."""
    frames = read_dataset(folder, "test").frames[::every]
    found = evaluate(predict_with(model), FrameStore(frames, model.spec), batch=4)
    values = {"box": found.box_ap, "mask": found.mask_ap, "keypoint": found.keypoint_ap}
    return {
        "frames": len(frames),
        **{name: round(v, 1) for name, v in values.items() if v is not None},
    }


def main() -> None:
    """Print one row per checkpoint and write all rows."""
    parser = program(__doc__)
    parser.add_argument("pictures", type=Path)
    parser.add_argument("test", type=Path)
    parser.add_argument("field_test", type=Path)
    parser.add_argument("--runs", nargs="+", required=True, metavar="NAME=CHECKPOINT")
    parser.add_argument("--every", type=int, default=8)
    options = parser.parse_args()
    known = read_record(options.result)
    rows = known.get("rows", {})
    for entry in options.runs:
        name, _, path = entry.partition("=")
        model, record = load_checkpoint(Path(path))
        training = record["training"]
        rows[name] = {
            "input": f"{model.spec.width}x{model.spec.height}",
            "steps": training.get("steps"),
            "seed": training.get("settings", {}).get("seed"),
            "pictures": on_pictures(model, options.pictures),
            "test": on_frames(model, options.test, options.every),
            "field-test": on_frames(model, options.field_test, options.every),
        }
        sys.stdout.write(f"{name}: {json.dumps(rows[name])}\n")
        sys.stdout.flush()
        if options.result is not None:
            known |= {"every": options.every, "rows": rows}
            write_text(options.result, json.dumps(known, indent=1) + "\n")


if __name__ == "__main__":
    main()
