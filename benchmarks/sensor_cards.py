"""What depth networks find with many depth cameras, and how far their outlines are off.

perceptree synth --out test_set --preset test
perceptree synth --out field_test_set --preset field-test
python -m benchmarks.sensor_cards test_set field_test_set --frames 60 \\
    --models edge-n-depth edge-s-depth --captures ../shared/data \\
    --result benchmarks/results/sensor_cards.json

Each frame is drawn through each camera of `benchmarks.sensor_views`. What counts: trees to 10 m of
which at least 400 px of a 1280 px wide frame and a quarter of the outline's area have readings.
`found` is the share of them with a detection (boxes that overlap by half, as in COCO); `right` the
share of the detections to 10 m that lie on any labelled tree. Outlines are compared row by row
where mask and label are one run each: `outward_px` is how far the mask's edges lie outside of the
label's, the mean of the middle 90 % of all edges, in px of the camera's picture, and `std_px` their
deviation. With --captures also real ones: time-of-flight captures of single stems, whose
outlines are those of their readings, and views of a laser scan of pines.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Bool, Float32
from benchmarks.sensor_views import VIEWS, SensorView
from benchmarks.tools.program import finish, machine, note, program
from calib import PinholeCamera, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import find_model
from edgetree.demo.matching import match_boxes
from perceptree.data import FrameRecord, read_dataset

REACH_M = 10.0
SCORE = 0.5
_LEAST_PX = 400  # of a picture of 1280x720
_READ_SHARE = 0.25
_BEAM_GAP_PX = 5
_FEWEST_ROWS = 5
_UPPER, _LEAST_OVERLAP = 0.4, 0.5  # of a capture, above the flare; of mask and readings
_CUT = 0.05  # share of the edges that are left out on each side
_SEED = 1000


@dataclass
class Score:
    """What a network found with one camera.

    Attributes:
        trees: Number of trees that count.
        found: Number of them that were found.
        shown: Number of detections to 10 m.
        right: Number of them on a labelled tree.
        edges_px: How far each edge of each matched row lies outside of the label's.
    """

    trees: int = 0
    found: int = 0
    shown: int = 0
    right: int = 0
    edges_px: list[Float32] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready figures."""
        edges = np.sort(np.concatenate([*self.edges_px, np.zeros(0, np.float32)]))
        cut = round(_CUT * len(edges))
        edges = edges[cut : len(edges) - cut]
        return {
            "trees": self.trees,
            "found": _share(self.found, self.trees),
            "right": _share(self.right, self.shown),
            "outward_px": round(float(edges.mean()), 2) if len(edges) else None,
            "std_px": round(float(edges.std()), 2) if len(edges) else None,
        }


def _share(part: int, whole: int) -> float | None:
    return round(part / whole, 3) if whole else None


def edge_errors(found: Bool, truth: Bool) -> Float32:
    """How far a mask's edges lie outside of another's, px.

    Args:
        found: (H, W) mask.
        truth: (H, W) mask of the same tree.

    Returns:
        (2 N,) for the left and right edges of the N rows where both are one run that does not
        touch the picture's border.
    """
    errors = []
    for row in np.flatnonzero(found.any(1) & truth.any(1)):
        runs = [
            np.flatnonzero(np.diff(mask[row], prepend=False, append=False))
            for mask in (found, truth)
        ]
        if any(len(run) != 2 or run[0] == 0 or run[1] == truth.shape[1] for run in runs):
            continue
        errors += [runs[1][0] - runs[0][0], runs[0][1] - runs[1][1]]
    return np.array(errors if len(errors) >= 2 * _FEWEST_ROWS else [], np.float32)


def exact_depth(frame: FrameRecord) -> Float32:
    """(H, W) exact depth of a frame, m; 0 for none."""
    assert frame.exact_path is not None
    depth_m = read_depth(frame.exact_path)
    return np.asarray(
        cv2.resize(depth_m, (frame.width, frame.height), interpolation=cv2.INTER_NEAREST),
        np.float32,
    )


def add_frame(
    score: Score, detector: TreeDetector, view: SensorView, frame: FrameRecord, number: int
) -> None:
    """Count what a detector finds in one frame as a camera sees it."""
    camera = view.camera_of(PinholeCamera.from_dict(frame.extra["camera"]))
    rng = np.random.default_rng([_SEED, frame.image_id, number])
    depth_m = view.sensor(rng, view.depth_of(exact_depth(frame)), camera)
    masks = [view.mask_of(frame.mask(tree)) for tree in frame.trees]
    seen = [n for n, mask in enumerate(masks) if mask.any()]
    boxes = np.array([_box(masks[n]) for n in seen], float).reshape(-1, 4)
    found = detector.detect(depth_m).above(SCORE)
    of_truth = {seen[m.truth]: m.detection for m in match_boxes(found.boxes_px, boxes)}
    for tree in seen:
        distance_m = frame.trees[tree].truth.get("distance_m", np.inf)
        if distance_m > REACH_M or not _counts(masks[tree], depth_m, view):
            continue
        score.trees += 1
        if tree in of_truth:
            score.found += 1
            score.edges_px.append(edge_errors(found.mask(of_truth[tree]), masks[tree]))
    for row in range(len(found)):
        if _distance_m(found, row, depth_m) <= REACH_M:
            score.shown += 1
            score.right += row in of_truth.values()


def _box(mask: Bool) -> tuple[int, int, int, int]:
    x, y, across, down = cv2.boundingRect(mask.view(np.uint8))
    return x, y, x + across, y + down


def _counts(mask: Bool, depth_m: Float32, view: SensorView) -> bool:
    """Whether enough of a tree is in the picture and has readings."""
    read = cv2.dilate((depth_m > 0).view(np.uint8), np.ones((_BEAM_GAP_PX,) * 2, np.uint8)) > 0
    least = _LEAST_PX * view.width * view.height / (1280 * 720)
    return bool(mask.sum() >= least and read[mask].mean() >= _READ_SHARE)


def _distance_m(found: TreeDetections, row: int, depth_m: Float32) -> float:
    readings = depth_m[found.mask(row) & (depth_m > 0)]
    return float(np.median(readings)) if len(readings) else np.inf


def simulated_cards(detector: TreeDetector, frames: list[FrameRecord]) -> dict[str, Any]:
    """The figures of every camera."""
    cards = {}
    for number, view in enumerate(VIEWS):
        score = Score()
        for frame in frames:
            add_frame(score, detector, view, frame, number)
        name = f"{view.name} {view.width}x{view.height}"
        cards[name] = score.to_dict()
        note(name, cards[name])
    return cards


def capture_cards(detector: TreeDetector, folder: Path) -> dict[str, Any]:
    """Captures of single stems: the share that is found, and the outlines against the readings."""
    kinds = {
        "tof_trees": sorted((folder / "tof_trees").glob("tree*_depth_mm.png")),
        "tof_portrait": sorted((folder / "tof_portrait").glob("mv[12]_*_depth_mm.png")),
    }
    cards = {}
    for name, paths in kinds.items():
        score = Score()
        for path in paths:
            depth_m = read_depth(path)
            if name == "tof_portrait":
                depth_m = np.ascontiguousarray(np.rot90(depth_m, -1))
            add_capture(score, detector, depth_m)
        cards[name] = score.to_dict()
        note(name, cards[name])
    return cards


def add_capture(score: Score, detector: TreeDetector, depth_m: Float32) -> None:
    """Count a capture of one stem that leaves the picture at the top."""
    found = detector.detect(depth_m).above(SCORE)
    end = round(_UPPER * len(depth_m))
    stem = _largest(depth_m > 0)[:end]
    masks = [found.mask(row)[:end] for row in range(len(found))]
    overlaps = [(mask & stem).sum() / max((mask | stem).sum(), 1) for mask in masks]
    score.trees += 1
    score.shown += len(found)
    if overlaps and max(overlaps) >= _LEAST_OVERLAP:
        score.found += 1
        score.right += 1
        score.edges_px.append(edge_errors(masks[int(np.argmax(overlaps))], stem))


def _largest(mask: Bool) -> Bool:
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(mask.view(np.uint8))
    if count < 2:
        return np.zeros(mask.shape, bool)
    return np.asarray(labels == 1 + int(statistics[1:, cv2.CC_STAT_AREA].argmax()))


def scan_cards(detector: TreeDetector, folder: Path) -> dict[str, Any]:
    """Views of a laser scan: the share of the listed stems that a detection's box holds."""
    views = folder / "clouds" / "truebelief_artemis_treeiso" / "views"
    cards = {}
    for name, file in (("with ground", "truth.json"), ("no ground", "truth_no_ground.json")):
        frames = json.loads((views / file).read_text("utf-8"))["frames"]
        trees = hits = 0
        for frame in frames:
            found = detector.detect(read_depth(views / f"{frame['frame']}.png")).above(SCORE)
            for stem in frame["stems"]:
                x, y = stem["breast_height_px"]
                x0, y0, x1, y1 = found.boxes_px.T
                trees += 1
                hits += bool(((x0 <= x) & (x <= x1) & (y0 <= y) & (y <= y1)).any())
        cards[f"pine scan, {name}"] = {"trees": trees, "found": _share(hits, trees)}
        note(name, cards[f"pine scan, {name}"])
    return cards


def chosen_frames(folders: list[Path], count: int) -> Iterator[FrameRecord]:
    """Evenly spread frames of the test splits, `count` of each folder."""
    for folder in folders:
        frames = read_dataset(folder, "test").frames
        yield from frames[:: max(1, len(frames) // count)][:count]


def main() -> None:
    """Print the cards of the models, and write them to a file."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="datasets with exact depth")
    parser.add_argument("--models", nargs="+", default=["edge-n-depth", "edge-s-depth"])
    parser.add_argument("--frames", type=int, default=60, help="frames of each dataset")
    parser.add_argument("--captures", type=Path, help="folder of real captures")
    options = parser.parse_args()
    frames = list(chosen_frames(options.data, options.frames))
    result: dict[str, Any] = {"machine": machine(), "frames": len(frames), "models": {}}
    for model in options.models:
        note(model)
        detector = TreeDetector.load(find_model(model), threads=1)
        cards = simulated_cards(detector, frames)
        if options.captures is not None:
            cards |= capture_cards(detector, options.captures)
            cards |= scan_cards(detector, options.captures)
        result["models"][Path(model).stem] = cards
    finish(result, options.result)


if __name__ == "__main__":
    main()
