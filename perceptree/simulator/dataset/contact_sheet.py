"""Contact sheets: an overview of a dataset's frames with their labels."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from basetree.files.reading import read_image
from calib import opencv_to_image
from perceptree.drawing import Picture, draw_trees, fitted, grid, with_caption
from perceptree.errors import DatasetError
from perceptree.simulator.dataset.storage import encode_jpeg, write_atomically
from perceptree.simulator.settings import TIMES, WEATHERS

Record = dict[str, Any]

SHEET_FILE = "contact_sheet.jpg"
DEPTH_SHEET_FILE = "contact_sheet_depth.jpg"

_CELLS = 48
_COLUMNS = 6
_CELL_WIDTH_PX = 400
_QUALITY = 88
_FULL_COLOUR_M = 20.0
_CONDITIONS = ("terrain", "weather", "light")


def write_contact_sheets(directory: Path, splits: dict[str, list[Record]]) -> None:
    """Write two sheets of the same frames: colour with labels, and measured depth.

    The frames are from scenes all over the dataset, chosen to show every ground, weather and
    light, and are sorted by weather and light.

    Args:
        directory: Folder of the dataset.
        splits: Frame records of each split.

    Raises:
        DatasetError: If an image cannot be read.
        OSError: If a sheet cannot be written.
    """
    chosen = choose_frames([record for records in splits.values() for record in records])
    colour, depth = [], []
    for record in chosen:
        text = _caption(record["image"])
        colour.append(with_caption(_colour_cell(directory, record), text))
        depth.append(with_caption(_depth_cell(directory, record["image"]), text))
    for name, cells in ((SHEET_FILE, colour), (DEPTH_SHEET_FILE, depth)):
        write_atomically(directory / name, encode_jpeg(grid(cells, _COLUMNS), _QUALITY))


def choose_frames(records: list[Record]) -> list[Record]:
    """Choose at most 48 frames: first one per scene, preferring the conditions shown least."""
    scenes: dict[int, list[Record]] = {}
    for record in sorted(records, key=lambda record: int(record["image"]["id"])):
        scenes.setdefault(record["image"]["scene"]["seed"], []).append(record)
    chosen: list[Record] = []
    shown: Counter[tuple[str, str]] = Counter()
    turn = 0
    while len(chosen) < _CELLS and any(len(frames) > turn for frames in scenes.values()):
        left = _spread(
            [
                frames[(n + turn) % len(frames)]
                for n, frames in enumerate(scenes.values())
                if len(frames) > turn
            ]
        )
        while left and len(chosen) < _CELLS:
            best = min(left, key=lambda record: sum(shown[c] for c in _conditions(record)))
            left.remove(best)
            shown.update(_conditions(best))
            chosen.append(best)
        turn += 1
    return sorted(chosen, key=_order)


def _spread(records: list[Record]) -> list[Record]:
    """Reorder records by a golden-ratio sequence, so that every prefix is spread over the whole."""
    golden = (5**0.5 - 1) / 2
    order = sorted(range(len(records)), key=lambda n: (n * golden) % 1)
    return [records[index] for index in order]


def _conditions(record: Record) -> list[tuple[str, str]]:
    scene = record["image"]["scene"]
    return [(name, scene[name]) for name in _CONDITIONS]


def _order(record: Record) -> tuple[int, int, str, int]:
    scene = record["image"]["scene"]
    weather, light = WEATHERS.index(scene["weather"]), TIMES.index(scene["light"])
    return weather, light, scene["terrain"], record["image"]["id"]


def _caption(image: dict[str, Any]) -> str:
    scene = image["scene"]
    sky = " overcast" if scene["overcast"] else ""
    strength = f" {scene['weather_strength']:.1f}" if scene["weather"] != "clear" else ""
    return (
        f"{scene['weather']}{strength}  {scene['light']}{sky}  {scene['terrain']}"
        f" {scene['slope_deg']:.0f} deg  #{image['id']}"
    )


def _read(path: Path, flag: int) -> NDArray[Any]:
    image = read_image(path, flag)
    if image is None:
        raise DatasetError(f"{path}: missing or not a readable image; remove it to have it redrawn")
    return image


def _colour_cell(directory: Path, record: Record) -> Picture:
    image = _read(directory / record["image"]["file_name"], cv2.IMREAD_COLOR)
    trees = record["annotations"]
    boxes = np.array([tree["bbox"] for tree in trees], float).reshape(-1, 4)
    boxes[:, 2:] += boxes[:, :2]
    keypoints = np.array([tree["keypoints"] for tree in trees], float).reshape(-1, 5, 3)
    keypoints[..., :2] = opencv_to_image(keypoints[..., :2])
    masks = (coco_mask.decode(tree["segmentation"]) for tree in trees)
    return draw_trees(
        np.asarray(image, np.uint8),
        boxes=boxes,
        masks=masks,
        keypoints=keypoints,
        width_px=_CELL_WIDTH_PX,
    )


def _depth_cell(directory: Path, image: dict[str, Any]) -> Picture:
    """Colour-coded depth: near is red, 20 m and beyond is dark blue, no reading is black."""
    millimetres = _read(directory / image["depth_file"], cv2.IMREAD_UNCHANGED)
    small = fitted(millimetres, _CELL_WIDTH_PX, cv2.INTER_NEAREST)
    share = 1 - np.clip(small / (1000 * _FULL_COLOUR_M), 0, 1)
    coloured = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.where((small > 0)[..., None], coloured, 0).astype(np.uint8)
