"""Accuracy of a model file on real pictures with manually drawn boxes.

python -m benchmarks.real_pictures PICTURES/instances.json --model rgb --drawn FOLDER

The label file has COCO's format. An annotation may have `certain: false`: a detection with at
least half of its box inside such a box is ignored (as with COCO's crowds). A certain stem counts as
found at an IoU of 0.5. AP50 uses all scores of at least 0.05; recall and precision use those of at
least 0.5. The pictures are only for evaluation: never train on them or choose a threshold by them.
With `--dataset FOLDER` the pictures are written as a dataset instead, in which stems that are not
certain are ignored: for `perceptree eval` and `perceptree calibrate-scores`.
"""

from __future__ import annotations

import contextlib
import io
import json
import shutil
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pycocotools.coco import COCO
from pycocotools.cocoeval import COCOeval

from basetree.files.reading import read_image
from basetree.files.writing import write_image
from benchmarks.tools.program import command_line
from edgetree import TreeDetections, TreeDetector, default_model
from edgetree.drawing.trees import draw_trees

SHOWN_SCORE = 0.5
LEAST_SCORE = 0.05
IOU = 0.5


def ground_truth(labels: Path) -> COCO:
    """The annotated boxes, with uncertain ones as crowds."""
    content = json.loads(labels.read_text("utf-8"))
    for annotation in content["annotations"]:
        annotation["iscrowd"] = int(not annotation.get("certain", True))
        annotation["area"] = annotation["bbox"][2] * annotation["bbox"][3]
    truth = COCO()
    truth.dataset = content
    with contextlib.redirect_stdout(io.StringIO()):
        truth.createIndex()
    return truth


@dataclass(frozen=True)
class Matches:
    """Detections beside the annotated boxes, at an IoU of 0.5; ignored ones are left out.

    Attributes:
        ap50: Average precision, %.
        stems: Number of certain stems.
        scores: (N,) scores, the highest first.
        right: (N,) whether each is a stem.
    """

    ap50: float
    stems: int
    scores: NDArray[np.float64]
    right: NDArray[np.bool_]


def compare(truth: COCO, found: list[dict[str, Any]]) -> Matches:
    """Match detections with the boxes."""
    if not found:  # which pycocotools does not read
        certain = sum(not each["iscrowd"] for each in truth.dataset["annotations"])
        return Matches(0.0, certain, np.zeros(0), np.zeros(0, bool))
    with contextlib.redirect_stdout(io.StringIO()):
        matched = COCOeval(truth, truth.loadRes(found), "bbox")
        matched.params.iouThrs = np.array([IOU])
        matched.params.areaRng = [[0, 1e10]]
        matched.params.areaRngLbl = ["all"]
        matched.evaluate()
        matched.accumulate()
    scores: list[float] = []
    right: list[bool] = []
    stems = 0
    for image in filter(None, matched.evalImgs):
        counted = ~np.asarray(image["dtIgnore"][0], bool)
        scores += np.asarray(image["dtScores"])[counted].tolist()
        right += (np.asarray(image["dtMatches"][0])[counted] > 0).tolist()
        stems += int((~np.asarray(image["gtIgnore"], bool)).sum())
    precision = matched.eval["precision"][0, :, 0, 0, -1]
    order = np.argsort(-np.asarray(scores), kind="stable")
    ap50 = round(100 * float(precision[precision > -1].mean()), 1)
    return Matches(ap50, stems, np.asarray(scores)[order], np.asarray(right, bool)[order])


def entries(image_id: int, trees: TreeDetections) -> list[dict[str, Any]]:
    """Convert detections to COCO's format."""
    x0, y0, x1, y1 = trees.boxes_px.T.astype(float)
    boxes = np.stack([x0, y0, x1 - x0, y1 - y0], 1).tolist()
    return [
        {"image_id": image_id, "category_id": 1, "bbox": box, "score": score}
        for box, score in zip(boxes, trees.scores.astype(float).tolist(), strict=True)
    ]


def write_dataset(labels: Path, content: dict[str, Any], out: Path) -> None:
    """Copy the pictures beside labels in which uncertain stems are ignored."""
    (out / "images").mkdir(parents=True, exist_ok=True)
    for image in content["images"]:
        picture = labels.parent / "images" / image["file_name"]
        shutil.copy(picture, out / "images" / picture.name)
        image["file_name"] = f"images/{picture.name}"
    for annotation in content["annotations"]:
        annotation["ignore"] = int(not annotation.pop("certain", True))
        annotation["iscrowd"] = 0
    (out / "test_RGB.json").write_text(json.dumps(content), "utf-8")


def main() -> None:
    """Print the results as JSON, and optionally draw the pictures."""
    parser = command_line(__doc__)
    parser.add_argument("labels", type=Path)
    parser.add_argument("--model", default="rgb", help="rgb for the embedded model, or a file")
    parser.add_argument("--drawn", type=Path, help="folder for the pictures with detections")
    parser.add_argument("--dataset", type=Path, help="folder to write a dataset to")
    arguments = parser.parse_args()
    if not arguments.labels.is_file():
        parser.error(f"{arguments.labels}: no such file, expected labels in COCO's form")
    if arguments.dataset is not None:
        content = json.loads(arguments.labels.read_text("utf-8"))
        write_dataset(arguments.labels, content, arguments.dataset)
        return
    truth = ground_truth(arguments.labels)
    model = default_model("rgb") if arguments.model == "rgb" else Path(arguments.model)
    detector = TreeDetector.load(model, threads=2, score_threshold=LEAST_SCORE)
    found: list[dict[str, Any]] = []
    for image in truth.dataset["images"]:
        path = arguments.labels.parent / "images" / image["file_name"]
        picture = read_image(path)
        if picture is None:
            parser.error(f"{path}: cannot be read, expected a picture")
        trees = detector.detect(picture)
        found += entries(image["id"], trees)
        if arguments.drawn is not None:
            arguments.drawn.mkdir(parents=True, exist_ok=True)
            drawn = draw_trees(np.asarray(picture, np.uint8), trees.above(SHOWN_SCORE))
            write_image(arguments.drawn / f"{path.stem}.jpg", drawn)
    matched = compare(truth, found)
    shown = matched.right[matched.scores >= SHOWN_SCORE]
    hits, wrong = int(shown.sum()), int((~shown).sum())
    result = {
        "model": arguments.model,
        "box AP50": matched.ap50,
        "stems": matched.stems,
        "found": hits,
        "wrong": wrong,
        "recall": round(hits / matched.stems, 3),
        "precision": round(hits / max(1, hits + wrong), 3),
    }
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
