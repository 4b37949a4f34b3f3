"""Choose sample frames for the package from a simulated dataset's test split.

perceptree synth --preset test --out forest
python -m release.samples forest edgetree/assets/samples
"""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

from benchmarks.tools.program import command_line

SAMPLES = 6
TREE_FIELDS = (
    "diameter_m",
    "cut_height_m",
    "distance_m",
    "inclination_deg",
    "visible_fraction",
    "species",
)


def sample_tree(tree: dict[str, Any]) -> dict[str, Any]:
    """Convert an annotation to a sample's ground truth, with corner-based keypoints and box."""
    x, y, width, height = tree["bbox"]
    points = [tree["keypoints"][start : start + 3] for start in range(0, 15, 3)]
    return {
        "box_px": [x, y, x + width, y + height],
        "keypoints_px": [[u + 0.5, v + 0.5, flag] if flag else [0, 0, 0] for u, v, flag in points],
        **{name: tree[name] for name in TREE_FIELDS},
    }


def choose(dataset: dict[str, Any]) -> list[tuple[dict[str, Any], list[dict[str, Any]]]]:
    """Choose frames with three to seven trees, one per scene, in the dataset's order."""
    chosen: dict[int, tuple[dict[str, Any], list[dict[str, Any]]]] = {}
    for image in dataset["images"]:
        trees = [tree for tree in dataset["annotations"] if tree["image_id"] == image["id"]]
        if 3 <= len(trees) <= 7:
            chosen.setdefault(image["scene"]["seed"], (image, trees))
    return list(chosen.values())


def main() -> None:
    """Write the samples' images, depth and ground truth."""
    parser = command_line(__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    files = [arguments.dataset / f"{split}_RGB.json" for split in ("train", "val", "test")]
    there = [file for file in files if file.exists()]
    frames = [frame for file in there for frame in choose(json.loads(file.read_text()))][:SAMPLES]
    if len(frames) < SAMPLES:
        parser.error(f"{len(frames)} suitable scenes, expected {SAMPLES}")
    arguments.out.mkdir(parents=True, exist_ok=True)
    for number, (image, trees) in enumerate(frames):
        name = arguments.out / f"sample_{number}"
        shutil.copyfile(arguments.dataset / image["file_name"], f"{name}.jpg")
        shutil.copyfile(arguments.dataset / image["depth_file"], f"{name}_depth_mm.png")
        truth = {
            "camera": image["camera"],
            "up_camera": image["up_camera"],
            "scene": image["scene"],
            "trees": [sample_tree(tree) for tree in trees],
        }
        Path(f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main()
