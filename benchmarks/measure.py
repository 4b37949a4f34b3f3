"""Accuracy of metric measurements on every labelled tree of simulated frames.

perceptree synth --out paper --preset paper --seed 905 --views 4 --frames 1500
perceptree synth --out field --preset field --seed 905 --views 4 --width 960 --height 540 \\
    --frames 1800
python -m benchmarks.measure paper field --first 800 \\
    --result benchmarks/results/measure_labels.json
python -m benchmarks.measure paper field --first 800 --model edge-n-depth \\
    --result benchmarks/results/measure_edge_n_depth.json

`--first` leaves out the frames before, which the depth models were trained on. Without `--model`,
keypoints and masks are the labels' and only the depth is noisy; with it they are the network's. A
tree counts as measured if its diameter is. With several folders the tables are of all frames and of
each folder. `--rows` keeps the values behind the tables, one JSON object per labelled tree.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from pycocotools import mask as coco_mask

from benchmarks.measure_tables import TRUTHS, tables
from calib import PinholeCamera, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import find_model
from edgetree.demo.matching import match_boxes
from edgetree.frames.images import read_image
from edgetree.measure import EXACT_RIG, Failure, MeasureSettings, TreeMeasurement, measure_trees

# The simulator's stems are rounder than real ones, and its depth cameras share less error within a
# stem: the steps of the disparity.
SIMULATED = MeasureSettings(out_of_round_std=0.0135, depth_bias_per_m=0.0002)
# Uncertainty of keypoints and masks that are exact to the pixel.
LABELS = replace(
    SIMULATED,
    keypoint_std_px=0.3,
    keypoint_spread=1e-6,
    keypoint_slide=1e-6,
    given_mask_std_px=0.35,
    outline_doubt=0.013,
    readings_doubt=0.27,
)


def frames(
    data: Path, count: int | None, first: int = 0
) -> Iterator[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Images with their annotations, of all splits, from the image with the number `first` on."""
    done = 0
    for path in sorted(data.glob("*_RGB.json")):
        coco = json.loads(path.read_text(encoding="utf-8"))
        trees: dict[int, list[dict[str, Any]]] = {image["id"]: [] for image in coco["images"]}
        for tree in coco["annotations"]:
            trees[tree["image_id"]].append(tree)
        for image in coco["images"]:
            if image["id"] < first:
                continue
            if count is None or done < count:
                yield image, trees[image["id"]]
            done += 1


def labelled(image: dict[str, Any], trees: list[dict[str, Any]]) -> TreeDetections:
    """Convert labels to detections, corner-based."""
    keypoints = np.array([tree["keypoints"] for tree in trees], np.float32).reshape(-1, 5, 3)
    given = keypoints[..., 2:] > 0
    keypoints = np.where(given, keypoints + np.array([0.5, 0.5, 0]), 0)
    keypoints[..., 2] = given[..., 0]
    boxes = np.array([tree["bbox"] for tree in trees], np.float32).reshape(-1, 4)
    boxes[:, 2:] += boxes[:, :2]
    return TreeDetections(
        boxes, np.ones(len(trees), np.float32), keypoints, None, image["width"], image["height"]
    )


def measured(
    data: Path,
    image: dict[str, Any],
    trees: list[dict[str, Any]],
    detector: TreeDetector | None,
    vertical: bool,
) -> list[tuple[TreeMeasurement | None, float | None]]:
    """Measurement of each labelled tree (None if it was not detected), and naive diameters."""
    depth_m = read_depth(data / image["depth_file"])
    camera = PinholeCamera.from_dict(image["camera"])
    up = image["up_camera"] if vertical else None
    truth = labelled(image, trees)
    naive_m = [naive_diameter_m(tree["keypoints"], depth_m, camera) for tree in trees]
    if detector is None:
        masks = [coco_mask.decode(tree["segmentation"]).astype(bool) for tree in trees]
        exact = measure_trees(
            truth,
            depth_m,
            camera,
            masks=masks,
            up_camera=up,
            settings=LABELS,
            rig_uncertainty=EXACT_RIG,
        )
        return list(zip(exact, naive_m, strict=True))
    takes_depth = detector.manifest.takes_depth
    picture = None if takes_depth else read_image(data / image["file_name"])
    found = detector.detect(picture, depth_m=depth_m)
    results = measure_trees(
        found, depth_m, camera, up_camera=up, rig_uncertainty=EXACT_RIG, settings=SIMULATED
    )
    of_truth = {m.truth: m.detection for m in match_boxes(found.boxes_px, truth.boxes_px)}
    matched = [results[of_truth[n]] if n in of_truth else None for n in range(len(trees))]
    return list(zip(matched, naive_m, strict=True))


def naive_diameter_m(
    keypoints: list[float], depth_m: np.ndarray, camera: PinholeCamera
) -> float | None:
    """The simple estimate: depth times pixel width over focal length, at labelled keypoints, m."""
    left, right = np.array(keypoints, float).reshape(5, 3)[1:3]
    column, row_px = np.rint((left + right)[:2] / 2).astype(int)
    if not (left[2] and right[2] and 0 <= row_px < len(depth_m) and 0 <= column < camera.width):
        return None
    z_m = float(depth_m[row_px, column])
    return z_m * float(np.hypot(*(right - left)[:2])) / camera.fx if z_m > 0 else None


def given_cut_height_m(
    image: dict[str, Any], tree: dict[str, Any], result: TreeMeasurement
) -> float | None:
    """True height above the ground of the place where a measurement puts the felling cut, m.

    The label's height is that of the labelled cut, whose place on the stem may be arbitrary. Here
    the line of sight to the cut that was found is intersected with the true stem: with the vertical
    through the bark that faces the camera at the labelled cut.
    """
    if isinstance(result.cut_point_m, Failure):
        return None
    up, axis_m = np.array(image["up_camera"]), np.array(tree["position_m"])
    level_m = axis_m - (axis_m @ up) * up
    bark_m = axis_m - tree["diameter_m"] / 2 * level_m / np.linalg.norm(level_m)
    sight = np.array(result.cut_point_m.xyz_m)
    sight /= np.linalg.norm(sight)
    across_m = bark_m - (bark_m @ sight) * sight
    across_up = up - (up @ sight) * sight
    above_m = -float(across_m @ across_up) / float(across_up @ across_up)
    return float(tree["cut_height_m"]) + above_m


def row(
    image: dict[str, Any],
    tree: dict[str, Any],
    result: TreeMeasurement | None,
    naive_m: float | None,
) -> dict[str, Any]:
    """True and measured values of one labelled tree."""
    values = {
        "image": image["id"],
        "sensor": image["depth_sensor"]["kind"],
        "visible_fraction": tree["visible_fraction"],
        "found": result is not None,
        "naive_m": naive_m,
        **{f"true_{name}": tree[label] for name, label in TRUTHS.items()},
    }
    if result is not None:
        values.update(result.to_dict())
        values["true_given_cut_height_m"] = given_cut_height_m(image, tree, result)
        if isinstance(result.diameter_m, Failure):
            values["diameter_failure"] = result.diameter_m.reason
    return values


def main() -> None:
    """Measure, print the tables, and optionally write them."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("data", type=Path, nargs="+")
    parser.add_argument("--model")
    parser.add_argument("--score-threshold", type=float, default=0.5)
    parser.add_argument("--frames", type=int)
    parser.add_argument("--first", type=int, default=0, help="number of the first frame")
    parser.add_argument("--no-vertical", action="store_true", help="estimate it, as without --up")
    parser.add_argument("--rows", type=Path)
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    detector = None
    if options.model is not None:
        detector = TreeDetector.load(
            find_model(options.model), threads=1, score_threshold=options.score_threshold
        )
    by_data: dict[str, list[dict[str, Any]]] = {}
    for data in options.data:
        of_data = by_data.setdefault(data.name, [])
        for image, trees in frames(data, options.frames, options.first):
            if trees:
                results = measured(data, image, trees, detector, not options.no_vertical)
                of_data += [
                    row(image, tree, *made) for tree, made in zip(trees, results, strict=True)
                ]
    rows = [values for of_data in by_data.values() for values in of_data]
    if options.rows is not None:
        options.rows.write_text("".join(json.dumps(values) + "\n" for values in rows))
    report = tables(rows)
    if len(by_data) > 1:
        report["by_data"] = {name: tables(of_data) for name, of_data in by_data.items()}
    sys.stdout.write(json.dumps(report, indent=1) + "\n")
    if options.result is not None:
        options.result.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
