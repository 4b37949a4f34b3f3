"""How many different stems are counted in simulated drives, without metres.

perceptree synth --out drive_1001 --preset drive --frames 60 --views 60 --width 640 \\
    --height 360 --seed 1001
python -m benchmarks.counting drive_1001 ... --result counting.json

The truth is the number of different stems that the model finds in at least three frames. One
that is of no labelled stem, as of one far away, is told from others by its place in the world, from
the exact depth.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Float
from benchmarks.tools.drives import drive_records
from benchmarks.tools.program import finish, program
from calib import PinholeCamera, RigidTransform, pixels_to_rays, read_depth
from edgetree import TreeDetections, TreeDetector
from edgetree.demo.matching import match_boxes
from edgetree.frames.images import read_image
from edgetree.live.tracking import PictureTracker

_FRAMES = 3
_SAME_PLACE_M = 1.0
_STEPS = (1, 2, 5)


def main() -> None:
    """Count the stems of drives at 10, 5 and 2 Hz."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of drives")
    parser.add_argument("--model", default="edge-s-rgb", help="colour model")
    arguments = parser.parse_args()
    detector = TreeDetector.load(arguments.model)
    result: dict[str, Any] = {}
    for folder in arguments.data:
        for scene in sorted((folder / "scenes").glob("*.json")):
            records = drive_records(scene)
            found = [_found(folder, record, detector) for record in records]
            stems = _stems(records, [trees for _, trees in found], folder)
            for step in _STEPS:
                name = f"{folder.name}-{scene.stem}, every {step}"
                result[name] = _counts(records[::step], found[::step], stems[::step])
    finish(result, arguments.result)


def _found(
    folder: Path, record: dict[str, Any], detector: TreeDetector
) -> tuple[np.ndarray, TreeDetections]:
    picture = read_image(folder / record["image"]["file_name"])
    return picture, detector.detect(picture)


def _counts(
    records: list[dict[str, Any]],
    found: list[tuple[np.ndarray, TreeDetections]],
    stems: list[list[str]],
) -> dict[str, int]:
    """True and counted stems, and stems with several numbers."""
    tracker, seen = PictureTracker(), dict[int, Counter[str]]()
    for record, (picture, trees), names in zip(records, found, stems, strict=True):
        numbers = tracker.update(picture, trees, record["image"]["time_s"])
        for number, name in zip(numbers, names, strict=True):
            if number is not None:
                seen.setdefault(number, Counter())[name] += 1
    times = Counter(name for names in stems for name in names)
    tracked = [each.most_common(1)[0][0] for each in seen.values()]
    return {
        "labelled": len({label["stem"] for each in records for label in each["annotations"]}),
        "true": sum(count >= _FRAMES for count in times.values()),
        "counted": tracker.count,
        "twice": len(tracked) - len(set(tracked)),
        "detections": times.total(),
    }


def _stems(
    records: list[dict[str, Any]], found: list[TreeDetections], folder: Path
) -> list[list[str]]:
    """The name of the stem of each detection: a labelled one, or one by its place."""
    named, places = [], list[list[Float]]()
    for record, trees in zip(records, found, strict=True):
        labels = record["annotations"]
        boxes = np.array([label["bbox"] for label in labels], np.float64).reshape(-1, 4)
        boxes[:, 2:] += boxes[:, :2]
        matches = match_boxes(trees.boxes_px, boxes) if len(trees) and len(labels) else []
        of_label = {each.detection: f"label {labels[each.truth]['stem']}" for each in matches}
        at = _places(folder, record["image"], trees)
        named.append([of_label.get(tree) or _by_place(at[tree], places) for tree in range(len(at))])
    return named


def _by_place(place: Float, places: list[list[Float]]) -> str:
    off = [float(np.linalg.norm(np.mean(each[-10:], axis=0) - place)) for each in places]
    nearest = int(np.argmin(off)) if off else -1
    if not off or off[nearest] > _SAME_PLACE_M:
        places.append([])
        nearest = len(places) - 1
    places[nearest].append(place)
    return f"place {nearest}"


def _places(folder: Path, image: dict[str, Any], trees: TreeDetections) -> Float:
    """(N, 2) places of the lower halves of the masks in the world, from the exact depth."""
    depth_m = read_depth(folder / "depth_exact" / Path(image["depth_file"]).name)
    size = (trees.image_width, trees.image_height)
    depth_m = np.asarray(cv2.resize(depth_m, size, interpolation=cv2.INTER_NEAREST), np.float32)
    pose = image["pose_world"]
    to_world = RigidTransform(np.transpose(pose["rotation"]), pose["origin_m"])
    camera, found = PinholeCamera.from_dict(image["camera"]), np.full((len(trees), 2), np.inf)
    for tree in range(len(trees)):
        rows, columns = np.nonzero(trees.mask(tree) & (depth_m > 0))
        if len(rows):
            low = rows >= np.median(rows)
            at = np.array([[np.median(columns[low]), np.median(rows[low])]]) + 0.5
            ray = pixels_to_rays(camera, at)[0]
            point = ray / ray[2] * np.median(depth_m[rows, columns])
            found[tree] = (to_world.rotation @ point + to_world.translation_m)[:2]
    return found


if __name__ == "__main__":
    main()
