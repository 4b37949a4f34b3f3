"""Choose sample frames for the package: four of the preset `test`, and two of `field` by hand.

perceptree synth --preset test --out forest
perceptree synth --preset field --seed 7051 --views 1 --frames 40 --out field
python -m release.samples forest edgetree/assets/samples --field field --images 9 2

Trees of `test` are all to be cut at 20 cm. Those of `field` differ, and its frames have grass (9)
and a flash at night (2). They were chosen by their pictures, before anything was measured in them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from benchmarks.tools.program import command_line

OF_TEST = 4
LARGEST_BYTES = 230_000  # of a picture, as the package is to stay below 20 MB
Chosen = tuple[dict[str, Any], list[dict[str, Any]]]
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


def choose(dataset: dict[str, Any]) -> list[Chosen]:
    """Choose frames with three to seven trees, one per scene, in the dataset's order."""
    chosen: dict[int, Chosen] = {}
    for image in dataset["images"]:
        trees = [tree for tree in dataset["annotations"] if tree["image_id"] == image["id"]]
        if 3 <= len(trees) <= 7:
            chosen.setdefault(image["scene"]["seed"], (image, trees))
    return list(chosen.values())


def by_number(dataset: dict[str, Any], number: int) -> list[Chosen]:
    """The frame of a number; empty if the dataset has none."""
    return [
        (image, [tree for tree in dataset["annotations"] if tree["image_id"] == number])
        for image in dataset["images"]
        if image["id"] == number
    ]


def small_jpeg(path: Path) -> bytes:
    """The content of a JPEG file, or the best encoding of its picture that is small enough."""
    content = path.read_bytes()
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None, path
    quality = 95
    while len(content) > LARGEST_BYTES:
        content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1].tobytes()
        quality -= 1
    return content


def splits(folder: Path) -> list[dict[str, Any]]:
    """The labels of a dataset's splits."""
    files = [folder / f"{split}_RGB.json" for split in ("train", "val", "test")]
    return [json.loads(file.read_text()) for file in files if file.exists()]


def smallest_png(path: Path) -> bytes:
    """The same pixels in the fewest bytes: the package may have 20 MB."""
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise SystemExit(f"{path} cannot be read: expected a PNG file")
    encoded = []
    for chosen in (cv2.IMWRITE_PNG_FILTER_NONE, cv2.IMWRITE_PNG_ALL_FILTERS):
        for strategy in (cv2.IMWRITE_PNG_STRATEGY_DEFAULT, cv2.IMWRITE_PNG_STRATEGY_FILTERED):
            flags = {
                cv2.IMWRITE_PNG_FILTER: chosen,
                cv2.IMWRITE_PNG_STRATEGY: strategy,
                cv2.IMWRITE_PNG_COMPRESSION: 9,
            }
            pairs = [number for pair in flags.items() for number in pair]
            encoded.append(cv2.imencode(".png", pixels, pairs)[1].tobytes())
    return min(encoded, key=len)


def main() -> None:
    """Write the samples' images, depth and ground truth."""
    parser = command_line(__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--field", type=Path, required=True)
    parser.add_argument("--images", type=int, nargs="+", required=True)
    arguments = parser.parse_args()
    of_test = [frame for labels in splits(arguments.dataset) for frame in choose(labels)]
    labels_of_field = splits(arguments.field)
    of_field = [
        frame
        for number in arguments.images
        for labels in labels_of_field
        for frame in by_number(labels, number)
    ]
    if len(of_test) < OF_TEST or len(of_field) < len(arguments.images):
        parser.error(
            f"{len(of_test)} suitable scenes and {len(of_field)} frames of --field, expected"
            f" {OF_TEST} and {len(arguments.images)}"
        )
    arguments.out.mkdir(parents=True, exist_ok=True)
    frames = [(arguments.dataset, *frame) for frame in of_test[:OF_TEST]]
    frames += [(arguments.field, *frame) for frame in of_field]
    for number, (folder, image, trees) in enumerate(frames):
        name = arguments.out / f"sample_{number}"
        Path(f"{name}.jpg").write_bytes(small_jpeg(folder / image["file_name"]))
        Path(f"{name}_depth_mm.png").write_bytes(smallest_png(folder / image["depth_file"]))
        truth = {
            "camera": image["camera"],
            "up_camera": image["up_camera"],
            "scene": image["scene"],
            "trees": [sample_tree(tree) for tree in trees],
        }
        Path(f"{name}.json").write_text(json.dumps(truth, indent=1) + "\n")


if __name__ == "__main__":
    main()
