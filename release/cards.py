"""Measure model files on the frozen test sets, and write a card beside each.

perceptree synth --out test_set --preset test
perceptree synth --out field_test_set --preset field-test
python -m release.cards --test test_set --field-test field_test_set

By default the models are the four of the package. NAME.json holds all figures (schema
`edgetree.card/1`), NAME.md the same as a page. What was found is counted as users get it: of trees
whose masks cover each other, one is kept. Speed is measured with one thread on the package's
frames; keep the machine quiet.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from basetree.files.writing import write_text
from benchmarks.measure import frames, measured, row
from benchmarks.measure_tables import tables
from benchmarks.tools.program import command_line
from edgetree import TreeDetector
from edgetree.bench.speed import bench_detector
from edgetree.doctor.machine import examine_machine
from edgetree.evaluate import chances_within_reach, frames_for, predict_with_file
from edgetree.model_file.card import CARD_SCHEMA
from edgetree.runtime import ColourAndDepth
from edgetree.runtime.duplicates import distinct_trees
from edgetree.samples import sample_frames
from perceptree.data import read_dataset
from perceptree.evaluation import About, Predict, RawDetections, make_report
from perceptree.models import load_checkpoint
from release.card_page import page

ROOT = Path(__file__).parents[1]
PURPOSE = {
    "depth": "depth images with or without colour",
    "rgb": "colour images",
    "both": "colour and depth together, or one of them",
}
DIAMETER_TABLES = ("diameter_by_distance", "diameter_by_diameter", "diameter_by_visible_fraction")
SHOWN_SCORE = 0.5
HALF = ("50", "from 75")
# Models that hold the weights of another one's checkpoint.
SAME_WEIGHTS = {"edge-s-rgb": "edge-n-rgb", "edge-s-any": "edge-s"}
FEWEST = 30
BENCH_S = 10.0


def once_per_tree(predict: Predict, max_overlap: float) -> Predict:
    """Drop trees whose mask covers one with a higher score, as the runtime does."""

    def predict_once(images: NDArray[np.uint8]) -> RawDetections:
        found = predict(images)
        if found.masks is None or found.keypoints is None:
            return found
        boxes, scores, counts = found.boxes.copy(), found.scores.copy(), found.num_detections.copy()
        keypoints, masks = found.keypoints.copy(), found.masks.copy()
        for image, count in enumerate(found.num_detections.tolist()):
            keep = np.flatnonzero(
                distinct_trees(boxes[image, :count], masks[image, :count], max_overlap)
            )
            counts[image] = len(keep)
            for values in (boxes, scores, keypoints, masks):
                values[image, : len(keep)] = values[image, keep]
        return RawDetections(boxes, scores, keypoints, masks, counts)

    return predict_once


def detection_figures(detector: TreeDetector, data: Path) -> dict[str, Any]:
    """Average precision, what is found at a score of 0.5, reliability and errors in px."""
    figures = _evaluated(detector, data, "both")
    shown = figures["at_score"]
    number = figures["data"]["frames"]
    return {
        "frames": number,
        "trees": figures["data"]["trees"],
        "average_precision": _average_precision(figures),
        "at_score": {
            "score": SHOWN_SCORE,
            "found": shown["found"],
            "invented": shown["invented"],
            "found_share": shown["recall"],
            "found_share_visible_half": _visible_half(figures["by"]),
            "found_per_frame": round(shown["found"] / number, 3),
            "invented_per_frame": round(shown["invented"] / number, 3),
            "precision": shown["precision"],
        },
        "reliability": figures["reliability"],
        "diameter_error_px": round(figures["diameter_error_px"]["mean_abs"], 2),
        "weakest": _weakest(figures["by"]),
    } | _alone(detector, data)


def _evaluated(detector: TreeDetector, data: Path, inputs: str) -> dict[str, Any]:
    """The figures of the report on a test set; of a model of both as `evaluate_file` says."""
    manifest = detector.manifest
    dataset = read_dataset(data, "test")
    predict = once_per_tree(
        predict_with_file(detector.session, manifest, inputs), manifest.thresholds.mask_overlap
    )
    store = frames_for(manifest, dataset.frames)
    about = About({"name": manifest.name}, data.name, "test", dataset.notes)
    chances, _ = chances_within_reach(manifest, dataset.frames, inputs)
    figures: dict[str, Any] = make_report(
        predict, store, about, manifest.input.batch_sizes[0], chances=chances
    ).figures
    return figures


def _average_precision(figures: dict[str, Any]) -> dict[str, float | None]:
    return {
        kind: None if found is None else round(found["ap"], 2)
        for kind, found in figures["average_precision"].items()
    }


def _alone(detector: TreeDetector, data: Path) -> dict[str, Any]:
    """What a model of both finds with one of its images; nothing for others."""
    found = {}
    for inputs in detector.manifest.graph_inputs if detector.manifest.takes_both else ():
        figures = _evaluated(detector, data, inputs)
        shown, number = figures["at_score"], figures["data"]["frames"]
        found[inputs] = {
            "average_precision": _average_precision(figures),
            "found_share": shown["recall"],
            "invented_per_frame": round(shown["invented"] / number, 3),
        }
    return {"alone": found} if found else {}


def _visible_half(by: dict[str, Any]) -> float | None:
    """Share of the trees found among those of which at least half of the lower trunk shows."""
    groups = by.get("visible_fraction", {"groups": []})["groups"]
    clear = [group for group in groups if group["name"].startswith(HALF)]
    trees: int = sum(group["trees"] for group in clear)
    found: float = sum(group["recall"] * group["trees"] for group in clear)
    return round(found / trees, 4) if trees else None


def _weakest(by: dict[str, Any]) -> list[dict[str, Any]]:
    """The groups of each condition in which the smallest share of the trees is found."""
    worst = []
    for axis in by.values():
        large = [group for group in axis["groups"] if group["trees"] >= FEWEST]
        if len(large) > 1:
            group = min(large, key=lambda each: each["recall"])
            worst.append(
                {"condition": axis["title"], "group": group["name"]}
                | {name: group[name] for name in ("trees", "recall", "boxes_ap")}
            )
    return sorted(worst, key=lambda each: each["recall"])


def metre_figures(detector: TreeDetector, data: Path) -> dict[str, Any]:
    """Errors of the measurement in metres against the simulated truth, gravity given."""
    rows = []
    for image, trees in frames(data, None):
        if trees:
            results = measured(data, image, trees, detector, vertical=True)
            rows += [row(image, tree, *made) for tree, made in zip(trees, results, strict=True)]
    made = tables(rows)
    return {name: made[name] for name in ("quantities", *DIAMETER_TABLES, "intervals")}


def speed_figures(detector: TreeDetector) -> dict[str, Any]:
    """Time of a detection on the package's frames, on this machine."""
    images = [ColourAndDepth(each.image(), each.depth_m()) for each in sample_frames()]
    result = bench_detector(detector, images, duration_s=BENCH_S)
    return {
        "machine": examine_machine().processor or "",
        "threads": result.threads,
        "detect_p50_ms": round(result.detect_p50_ms, 1),
        "detect_p90_ms": round(result.detect_p90_ms, 1),
        "runs": result.runs,
    }


def training_record(path: Path, checkpoints: Path) -> dict[str, Any] | None:
    """What the checkpoint with a model's weights tells of its training; None without one."""
    own = checkpoints / f"{path.stem}.safetensors"
    shared = checkpoints / f"{SAME_WEIGHTS.get(path.stem, path.stem)}.safetensors"
    found = next((each for each in (own, shared) if each.is_file()), None)
    return None if found is None else dict(load_checkpoint(found)[1]["training"])


def training_figures(record: dict[str, Any]) -> dict[str, Any]:
    """The last run, as the card tells it."""
    return {
        "data": record["data"],
        "frames": record["frames"],
        "steps": record["steps"],
        "batch": record["settings"]["batch"],
        "learning_rate": record["settings"]["learning_rate"],
        "schedule": record["settings"]["schedule"],
        "seed": record["settings"]["seed"],
        "hours": round(record["elapsed_s"] / 3600, 2),
        "device": record.get("device", "two CPU cores"),
        "init": record["init"],
        "averaged_runs": max(1, len(record.get("average_of", []))),
        "pretrained": record.get("pretrained", []),
        "photographs": record.get("photographs", []),
        "score_calibration": record.get("score_calibration"),
    }


def training_scenes(path: Path, record: dict[str, Any] | None) -> list[dict[str, Any]]:
    """The simulated scenes that the weights, the scale of the scores and the file were made with.

    They are what the card before says, and what the checkpoint tells of the seeds of its last run
    that are not among them. A new model begins with a card of `release/scenes.py`.

    Raises:
        SystemExit: Neither tells anything.
    """
    before = path.with_suffix(".json")
    known: list[dict[str, Any]] = []
    if before.is_file():
        known += json.loads(before.read_text(encoding="utf-8")).get("training_scenes", [])
    if record is not None:
        trained = {each["seed"] for each in known if each["use"].startswith("training")}
        known += [
            {"use": "training", "data": record["data"], **scenes}
            for scenes in record.get("scenes", [])
            if scenes["seed"] not in trained
        ]
    if not known:
        sys.exit(
            f"{before} has no training_scenes: expected the scenes that {path.name} was made of"
        )
    return known


def card(path: Path, sets: dict[str, Path], checkpoints: Path) -> dict[str, Any]:
    """Measure one file."""
    record = training_record(path, checkpoints)
    detector = TreeDetector.load(path, threads=1, score_threshold=SHOWN_SCORE)
    manifest = detector.manifest
    fastest = f"edge-n-{manifest.modality}"
    compared = "the fastest" if path.stem == fastest else f"slower and more accurate than {fastest}"
    purpose = PURPOSE[manifest.modality]
    if manifest.alone:
        purpose += f", then as {' or '.join(each.name for each in manifest.alone.values())}"
    figures: dict[str, Any] = {
        "schema": CARD_SCHEMA,
        "model": path.stem,
        "model_sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "date": time.strftime("%Y-%m-%d"),
        "for": purpose if manifest.takes_both else f"{purpose}; {compared}",
        "precision": manifest.precision,
        "file_bytes": path.stat().st_size,
        "parameters": manifest.parameters,
        "input_px": [manifest.input.width, manifest.input.height],
        "training": None if record is None else training_figures(record),
        "training_scenes": training_scenes(path, record),
    }
    for name, data in sets.items():
        sys.stderr.write(f"{path.stem} on {name}\n")
        figures[name] = detection_figures(detector, data) | {
            "metres": metre_figures(detector, data)
        }
    figures["speed"] = speed_figures(detector)
    return figures


def main() -> None:
    """Measure the models, and write their cards."""
    parser = command_line(__doc__)
    parser.add_argument("--test", type=Path, required=True, help="folder of the preset test")
    parser.add_argument("--field-test", type=Path, required=True, help="that of field-test")
    parser.add_argument("--models", type=Path, nargs="*", help="files; those of the package if not")
    parser.add_argument(
        "--checkpoints",
        type=Path,
        default=ROOT / "checkpoints",
        help="folder of NAME.safetensors, for what the card says of the training",
    )
    options = parser.parse_args()
    sets = {"test": options.test, "field_test": options.field_test}
    for path in options.models or sorted((ROOT / "edgetree/assets/models").glob("*.onnx")):
        figures = card(path, sets, options.checkpoints)
        write_text(path.with_suffix(".json"), json.dumps(figures, indent=1) + "\n")
        write_text(path.with_suffix(".md"), page(figures))
        sys.stderr.write(f"{path.with_suffix('.json')}\n")


if __name__ == "__main__":
    main()
