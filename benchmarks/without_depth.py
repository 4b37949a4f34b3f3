"""Accuracy without depth: by the camera's height, by a marker, by the camera's motion.

python -m benchmarks.without_depth --data FOLDER --frames 120 --seeds 1000 1032 \\
    --result benchmarks/results/without_depth.json

FOLDER holds simulated datasets; their depth is not used, except to draw a marker onto a stem. Rigs
are given with errors of the stated deviations (`without_depth_frames`). "given" uses exact outlines
and keypoints, "network" those of `edge-n-rgb` on the colour picture, both with the settings of
simulated stems. Drives of the ray caster give the motion, where all stems are in all frames. For
each quantity: the stems asked for, the share given, the median error (relative, of heights in
metres), the median standard deviation likewise, and the share inside the 95 % interval and beyond 3
standard deviations.
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from pycocotools import mask as coco_mask

from basetree.arrays import Bool, Float
from benchmarks.fit_cases import say
from benchmarks.measure import SIMULATED, frames, labelled
from benchmarks.metres.stand import Stand, Stem
from benchmarks.without_depth_frames import MARKER_ID, MARKER_M, given_rig, with_marker
from calib import PinholeCamera, RigidTransform, pixels_to_rays, read_depth
from calib.boards import SingleMarker
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import find_model
from edgetree.demo.matching import match_boxes
from edgetree.frames.images import read_image
from edgetree.measure import (
    EXACT_RIG,
    ScaleMark,
    ScaleMarks,
    StemViews,
    TreeMeasurement,
    Way,
    measure_without_depth,
)

_TRUTHS: Final = {
    "distance_m": "distance_m",
    "diameter_m": "diameter_m",
    "dbh_m": "diameter_breast_m",
    "cut_height_m": "cut_height_m",
}
# An axis bends aside by this share of the length at most.
_BENDS = 0.15
_DRIVE_STEPS, _STEP_M = 9, 0.25
_POSE_TURN_DEG, _POSE_SCALE = 0.2, 0.02
# From the stand's level axes (right, down, ahead) to a fixed frame with z up.
_FIXED: Final = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])

Rows = dict[tuple[str, str], list[tuple[float, float, float]]]


def masks_of(trees: list[dict[str, Any]]) -> list[Bool]:
    """(H, W) exact masks."""
    return [coco_mask.decode(tree["segmentation"]).astype(bool) for tree in trees]


def add(rows: Rows, name: str, tree: TreeMeasurement, truth: dict[str, Any]) -> None:
    """Add the values of one stem; NaN for those that are not given."""
    for quantity, key in _TRUTHS.items():
        value, true = getattr(tree, quantity), float(truth.get(key, truth.get(quantity, np.nan)))
        found = (value.value, value.std) if value else (np.nan, np.nan)
        rows[name, quantity].append((*found, true))


def by_height(rows: Rows, folder: Path, count: int, detector: TreeDetector) -> None:
    """Measure all labelled trees of a dataset by the camera's height."""
    for image, trees in frames(folder, count):
        if not trees:
            continue
        rig = given_rig(image, trees, np.random.default_rng(image["id"]))
        truth = labelled(image, trees)
        known: dict[str, Any] = {
            "up_camera": rig.up,
            "rig_uncertainty": rig.uncertainty,
            "settings": SIMULATED,
        }
        ways: list[Way] = [rig.height]
        exact = measure_without_depth(truth, rig.camera, ways, masks=masks_of(trees), **known)
        for tree, label in zip(exact, trees, strict=True):
            add(rows, "camera height, given", tree, label)
        found = detector.detect(read_image(folder / image["file_name"]))
        results = measure_without_depth(found, rig.camera, ways, **known)
        for match in match_boxes(found.boxes_px, truth.boxes_px):
            add(rows, "camera height, network", results[match.detection], trees[match.truth])


def by_marker(rows: Rows, folder: Path, count: int, detector: TreeDetector) -> tuple[int, int]:
    """Draw a marker onto one stem of each frame; returns how many were drawn and found."""
    drawn = seen = 0
    for image, trees in frames(folder, count):
        rng = np.random.default_rng(image["id"])
        bark_m = _bark_m(folder, image, trees, rng) if trees else None
        if bark_m is None:
            continue
        number, point_m = bark_m
        drawn += 1
        camera, up = PinholeCamera.from_dict(image["camera"]), np.array(image["up_camera"])
        picture = with_marker(read_image(folder / image["file_name"]), camera, point_m, up, rng)
        marker = SingleMarker("4x4_50", MARKER_ID, MARKER_M)
        corners = marker.detect(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8))
        seen += len(corners) > 0
        rig, truth = given_rig(image, trees, rng), labelled(image, trees)
        marks = [ScaleMark(corners_px, MARKER_M, "the marker") for corners_px in corners]
        ways: list[Way] = [ScaleMarks(marks, "no marker")]
        known: dict[str, Any] = {
            "up_camera": rig.up,
            "rig_uncertainty": rig.uncertainty,
            "settings": SIMULATED,
        }
        exact = measure_without_depth(truth, rig.camera, ways, masks=masks_of(trees), **known)
        add(rows, "marker, given", exact[number], trees[number])
        found = detector.detect(picture)
        results = measure_without_depth(found, rig.camera, ways, **known)
        for match in match_boxes(found.boxes_px, truth.boxes_px):
            if match.truth == number:
                add(rows, "marker, network", results[match.detection], trees[number])
    return drawn, seen


def _bark_m(
    folder: Path, image: dict[str, Any], trees: list[dict[str, Any]], rng: np.random.Generator
) -> tuple[int, Float] | None:
    """A tree, and a camera point on its bark in the middle of a row of its mask."""
    number = int(rng.integers(len(trees)))
    mask = masks_of(trees)[number]
    row = int(np.quantile(np.flatnonzero(mask.any(1)), 0.6)) if mask.any() else 0
    columns = np.flatnonzero(mask[row])
    if not len(columns):
        return None
    column, stride = int(columns.mean()), image["depth_exact_stride_px"]
    depth_m = read_depth(folder / image["depth_exact_file"])[row // stride, column // stride]
    if not (mask[row, column] and depth_m > 0):
        return None
    camera = PinholeCamera.from_dict(image["camera"])
    point_m = pixels_to_rays(camera, np.array([column + 0.5, row + 0.5])) * float(depth_m)
    return (number, point_m) if _is_bark(image, trees[number], point_m) else None


def _is_bark(image: dict[str, Any], tree: dict[str, Any], point_m: Float) -> bool:
    """Whether a camera point is on the stem of a tree, and not on a branch of it or a twig."""
    from_cut_m, up = point_m - np.array(tree["position_m"]), np.array(image["up_camera"])
    above_m = float(from_cut_m @ up)
    aside_m = float(np.linalg.norm(from_cut_m - above_m * up))
    leans_m = abs(above_m) * np.tan(np.radians(tree["inclination_deg"]))
    return bool(aside_m < tree["diameter_m"] + leans_m + _BENDS * abs(above_m))


def by_motion(rows: Rows, seed: int, *, aside: bool) -> None:
    """Drive 2 m ahead or aside past stems, and measure them in the last frame."""
    rng = np.random.default_rng(seed)
    stems = [
        Stem(
            diameter_m=rng.uniform(0.12, 0.5),
            right_m=rng.uniform(-2.5, 2.5),
            ahead_m=ahead_m,
            lean_deg=abs(rng.normal(0, 3)),
            lean_towards_deg=rng.uniform(0, 360),
        )
        for ahead_m in rng.uniform(5.5, 9, 5)
    ]
    views, scale = StemViews(), 1 + _POSE_SCALE * rng.standard_normal()
    for stand, pose in _drive(stems, seed, scale, rng, aside=aside):
        if min(mask.sum() for mask in stand.masks()) < 30:
            return
        trees: TreeDetections = stand.detections(rng)
        found = measure_without_depth(
            trees,
            stand.camera,
            [views.at(pose)],
            up_camera=stand.up,
            rig_uncertainty=EXACT_RIG,
        )
    name = f"motion {'aside' if aside else 'ahead'}"
    for number, tree in zip(stand.measured, found, strict=True):
        add(rows, name, tree, stand.truth(number))


def _drive(
    stems: list[Stem], seed: int, scale: float, rng: np.random.Generator, *, aside: bool
) -> Iterator[tuple[Stand, RigidTransform]]:
    """Frames of a drive with poses whose turns and distances have errors."""
    camera = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)
    for step in range(_DRIVE_STEPS):
        right_m, ahead_m = (_STEP_M * step, 0.0) if aside else (0.05 * np.sin(step), _STEP_M * step)
        moved = [
            replace(stem, right_m=stem.right_m - right_m, ahead_m=stem.ahead_m - ahead_m)
            for stem in stems
        ]
        stand = Stand(moved, camera, seed=seed)
        x, y, z = np.radians(_POSE_TURN_DEG) * rng.standard_normal(3)
        left, _, right = np.linalg.svd(np.array([[1, -z, y], [z, 1, -x], [-y, x, 1]]))
        turn = _FIXED @ stand.to_camera.T @ left @ right
        yield stand, RigidTransform(turn, np.array([right_m * scale, ahead_m * scale, 1.8]))


def summary(name: tuple[str, str], values: list[tuple[float, float, float]]) -> dict[str, Any]:
    """The scores of one quantity; heights are in metres, all else is relative."""
    table = np.array(values)
    given = np.isfinite(table[:, 0])
    value, std, true = table[given].T
    unit = np.ones_like(true) if name[1] == "cut_height_m" else true
    size = np.abs(value - true) / std
    return {
        "stems": len(table),
        "given": int(given.sum()),
        "median_error": round(float(np.median(np.abs(value - true) / unit)), 4),
        "median_std": round(float(np.median(std / unit)), 4),
        "inside_95": round(float((size <= 1.96).mean()), 4),
        "beyond_3_std": round(float((size > 3).mean()), 4),
    }


def main() -> None:
    """Measure, print and write the scores."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of the datasets")
    parser.add_argument("--datasets", nargs="*", default=["test-44", "field-test-45"])
    parser.add_argument("--frames", type=int, default=120, help="of each dataset")
    parser.add_argument("--ways", nargs="*", default=["height", "marker", "motion"])
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1024), help="of the drives")
    parser.add_argument("--result", type=Path, help="file that takes the scores beside its own")
    options = parser.parse_args()
    detector = TreeDetector.load(find_model("edge-n-rgb"), threads=1, score_threshold=0.5)
    rows: Rows = defaultdict(list)
    for name in options.datasets:
        if "height" in options.ways:
            by_height(rows, options.data / name, options.frames, detector)
        if "marker" in options.ways:
            drawn, seen = by_marker(rows, options.data / name, options.frames, detector)
            say(f"{name}: {seen} of {drawn} markers found")
    for seed in range(*options.seeds) if "motion" in options.ways else ():
        by_motion(rows, seed, aside=bool(seed % 2))
    scores = {", ".join(key): summary(key, values) for key, values in rows.items()}
    for key, score in scores.items():
        say(f"{key}: {score}")
    if options.result is not None:
        stored = options.result
        before = json.loads(stored.read_text(encoding="utf-8")) if stored.is_file() else {}
        stored.write_text(json.dumps(before | scores, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
