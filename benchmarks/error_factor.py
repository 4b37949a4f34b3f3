"""Fit how large a model file's errors of keypoints and mask edges are, and write it into the file.

perceptree synth --out cal_paper --preset paper --seed 909 --views 2 --frames 160
perceptree synth --out cal_field --preset field --seed 909 --views 2 --frames 160
python -m benchmarks.error_factor MODEL.onnx cal_paper cal_field

The constants of `MeasureSettings` were fitted to the embedded depth file. Another file may find
edges less or more exactly: its manifest says by which factor (`error_factor`). It is the smallest
one with which `HELD` of the 95 % intervals hold, of the diameters at the cut, of those at breast
height and of the cut heights, each. DATA are datasets of scenes that the model was not trained on.
Only the manifest changes: the graph keeps its bytes. Make the file's card anew afterwards
(`release/cards.py`), because the stated errors change.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import SIMULATED, frames, labelled
from benchmarks.measure_tables import TRUTHS
from calib import PinholeCamera, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.demo.matching import match_boxes
from edgetree.frames.images import read_image
from edgetree.measure import EXACT_RIG, Estimate, measure_trees
from release.manifest_change import write_manifest

SCORE_THRESHOLD = 0.5
FACTORS = np.round(np.geomspace(0.6, 3.0, 17), 2)
HELD = 0.95
QUANTITIES = ("diameter_m", "dbh_m", "cut_height_m")

Case = tuple[TreeDetections, Path, dict[str, Any], list[dict[str, Any]]]


def detected(model: Path, folders: list[Path]) -> list[Case]:
    """What the model finds in each frame, with the frame's depth file and labels."""
    detector = TreeDetector.load(model, score_threshold=SCORE_THRESHOLD)
    cases = []
    for folder in folders:
        for image, trees in frames(folder, None):
            depth = folder / image["depth_file"]
            takes_depth = detector.manifest.takes_depth
            picture = None if takes_depth else read_image(folder / image["file_name"])
            found = detector.detect(picture, depth_m=read_depth(depth))
            cases.append((found, depth, image, trees))
    return cases


def shares_inside(cases: list[Case], factor: float) -> list[tuple[int, float]]:
    """Number of values and share inside their 95 % intervals, for each of `QUANTITIES`."""
    inside: dict[str, list[bool]] = {name: [] for name in QUANTITIES}
    for found, depth, image, trees in cases:
        camera = PinholeCamera.from_dict(image["camera"])
        scaled = replace(found, error_factor=factor)
        known = {
            "up_camera": image["up_camera"],
            "rig_uncertainty": EXACT_RIG,
            "settings": SIMULATED,  # as of cards
        }
        results = measure_trees(scaled, read_depth(depth), camera, **known)
        for match in match_boxes(found.boxes_px, labelled(image, trees).boxes_px):
            for name in QUANTITIES:
                value = getattr(results[match.detection], name)
                true = trees[match.truth][TRUTHS[name]]
                if isinstance(value, Estimate) and true is not None:
                    low, high = value.interval95
                    inside[name].append(low <= true <= high)
    return [(len(each), float(np.mean(each))) for each in inside.values()]


def fitted(cases: list[Case]) -> float:
    """The smallest of `FACTORS` with which enough intervals hold; prints what each gives."""
    sys.stdout.write("factor  inside, %: " + ", ".join(QUANTITIES) + "\n")
    for factor in FACTORS.tolist():
        shares = shares_inside(cases, factor)
        words = "  ".join(f"{100 * share:.1f} of {count}" for count, share in shares)
        sys.stdout.write(f"{factor:6.2f}  {words}\n")
        if min(share for _, share in shares) >= HELD:
            return float(factor)
    sys.exit(f"no factor up to {FACTORS[-1]} holds {100 * HELD:.0f} % of the intervals")


def main() -> None:
    """Fit the factor and write it into the file."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("model", type=Path)
    parser.add_argument("data", type=Path, nargs="+")
    options = parser.parse_args()
    factor = fitted(detected(options.model, options.data))
    write_manifest(options.model, lambda manifest: replace(manifest, error_factor=factor))


if __name__ == "__main__":
    main()
