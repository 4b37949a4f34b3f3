"""Contact sheets: what a dataset looks like, with its labels drawn on, at a glance."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from perceptree.errors import DatasetError
from perceptree.simulator.dataset.storage import encode_jpeg, write_atomically
from perceptree.simulator.settings import TIMES, WEATHERS

Picture = NDArray[np.uint8]
Record = dict[str, Any]

SHEET_FILE = "contact_sheet.jpg"
DEPTH_SHEET_FILE = "contact_sheet_depth.jpg"

_CELLS = 48
_COLUMNS = 6
_CELL_WIDTH_PX = 400
_CAPTION_PX = 24
_GAP_PX = 6
_QUALITY = 88
_FULL_COLOUR_M = 20.0
_CONDITIONS = ("terrain", "weather", "light")
# BGR
_PAPER, _INK = (24, 22, 20), (225, 228, 226)
_BOX, _OUTLINE = (80, 210, 255), (120, 255, 120)
_KEYPOINTS = ((60, 60, 255), (255, 200, 40), (40, 160, 255), (240, 240, 240), (255, 120, 220))


def write_contact_sheets(directory: Path, splits: dict[str, list[Record]]) -> None:
    """Write two sheets of the same frames: colour with labels, and the measured depth.

    Frames come from scenes spread over the dataset, so chosen that every ground, weather and
    light is shown where there is one, and are ordered by weather and light.
    """
    chosen = choose_frames([record for records in splits.values() for record in records])
    colour, depth = [], []
    for record in chosen:
        text = _caption(record["image"])
        colour.append(_with_caption(_colour_cell(directory, record), text))
        depth.append(_with_caption(_depth_cell(directory, record["image"]), text))
    for name, cells in ((SHEET_FILE, colour), (DEPTH_SHEET_FILE, depth)):
        write_atomically(directory / name, encode_jpeg(_grid(cells), _QUALITY))


def choose_frames(records: list[Record]) -> list[Record]:
    """At most 48 frames: at first one a scene, the conditions shown least before the others."""
    scenes: dict[int, list[Record]] = {}
    for record in sorted(records, key=lambda record: int(record["image"]["id"])):
        scenes.setdefault(record["image"]["scene"]["seed"], []).append(record)
    chosen: list[Record] = []
    shown: Counter[tuple[str, str]] = Counter()
    turn = 0
    while len(chosen) < _CELLS and any(len(frames) > turn for frames in scenes.values()):
        left = _spread([frames[(n + turn) % len(frames)] for n, frames in enumerate(scenes.values())
                        if len(frames) > turn])  # fmt: skip
        while left and len(chosen) < _CELLS:
            best = min(left, key=lambda record: sum(shown[c] for c in _conditions(record)))
            left.remove(best)
            shown.update(_conditions(best))
            chosen.append(best)
        turn += 1
    return sorted(chosen, key=_order)


def _spread(records: list[Record]) -> list[Record]:
    """The same records, every prefix of them spread over the whole: a golden-ratio sequence."""
    golden = (5**0.5 - 1) / 2
    places = sorted(range(len(records)), key=lambda n: (n * golden) % 1)
    return [records[place] for place in places]


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
    image = cv2.imread(str(path), flag)
    if image is None:
        raise DatasetError(f"{path}: missing or not a readable image; remove it to have it redrawn")
    return image


def _fitted(image: NDArray[Any], interpolation: int) -> NDArray[Any]:
    height = round(image.shape[0] * _CELL_WIDTH_PX / image.shape[1])
    return np.asarray(cv2.resize(image, (_CELL_WIDTH_PX, height), interpolation=interpolation))


def _colour_cell(directory: Path, record: Record) -> Picture:
    image = _read(directory / record["image"]["file_name"], cv2.IMREAD_COLOR)
    scale = _CELL_WIDTH_PX / record["image"]["width"]
    cell: Picture = _fitted(image, cv2.INTER_AREA).astype(np.uint8)
    for tree in record["annotations"]:
        mask = coco_mask.decode(tree["segmentation"])
        small = _fitted(mask * np.uint8(255), cv2.INTER_AREA) > 127
        contours, _ = cv2.findContours(
            small.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(cell, contours, -1, _OUTLINE, 1)
        x, y, width, height = (value * scale for value in tree["bbox"])
        corners = (round(x), round(y)), (round(x + width) - 1, round(y + height) - 1)
        cv2.rectangle(cell, *corners, _BOX, 1)
    for tree in record["annotations"]:
        for number, colour in enumerate(_KEYPOINTS):
            x, y, flag = tree["keypoints"][3 * number : 3 * number + 3]
            if flag:
                place = (int((x + 0.5) * scale), int((y + 0.5) * scale))
                cv2.circle(cell, place, 2, colour, -1 if flag == 2 else 1, cv2.LINE_AA)
    return cell


def _depth_cell(directory: Path, image: dict[str, Any]) -> Picture:
    """Near is red, 20 m and beyond dark blue, no reading black."""
    millimetres = _read(directory / image["depth_file"], cv2.IMREAD_UNCHANGED)
    small = _fitted(millimetres, cv2.INTER_NEAREST)
    share = 1 - np.clip(small / (1000 * _FULL_COLOUR_M), 0, 1)
    coloured = cv2.applyColorMap((share * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    return np.where((small > 0)[..., None], coloured, 0).astype(np.uint8)


def _with_caption(cell: Picture, text: str) -> Picture:
    strip = np.full((_CAPTION_PX, _CELL_WIDTH_PX, 3), _PAPER, np.uint8)
    cv2.putText(
        strip, text, (2, _CAPTION_PX - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.42, _INK, 1, cv2.LINE_AA
    )
    return np.concatenate([cell, strip])


def _grid(cells: list[Picture]) -> Picture:
    """The cells in rows, gaps between them."""
    columns = min(_COLUMNS, len(cells))
    rows = -(-len(cells) // columns)
    height, width = cells[0].shape[0] + _GAP_PX, _CELL_WIDTH_PX + _GAP_PX
    sheet = np.full((rows * height + _GAP_PX, columns * width + _GAP_PX, 3), _PAPER, np.uint8)
    for number, cell in enumerate(cells):
        top, left = _GAP_PX + number // columns * height, _GAP_PX + number % columns * width
        sheet[top : top + cell.shape[0], left : left + _CELL_WIDTH_PX] = cell
    return sheet
