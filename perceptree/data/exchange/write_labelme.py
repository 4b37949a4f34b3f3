"""Write frames as labelme reads them: a JSON file beside each picture."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from basetree.files.writing import write_text
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.exchange.outlines import outlines
from perceptree.data.exchange.places import Places
from perceptree.keypoints import KEYPOINT_NAMES

_VERSION = "5.5.0"  # of labelme, whose form this is
_HIDDEN = 1  # COCO's flag


def write_labelme(out: Path, splits: Mapping[str | None, Sequence[FrameRecord]]) -> list[str]:
    """Write a folder for each split; `group_id` joins the shapes of one tree.

    Returns:
        Messages for the user about what the form cannot hold.
    """
    places = Places(out, [frame for frames in splits.values() for frame in frames])
    measured = 0
    for split, frames in splits.items():
        folders = () if split is None else (split,)
        for frame in frames:
            name = places.copy(frame.image_path, *folders).rpartition("/")[2]
            content: dict[str, Any] = {
                "version": _VERSION,
                "flags": {},
                "shapes": [
                    shape
                    for group, tree in enumerate(frame.trees, 1)
                    for shape in _shapes(frame, tree, group)
                ],
                "imagePath": name,
                "imageData": None,
                "imageHeight": frame.height,
                "imageWidth": frame.width,
            }
            measured += frame.has_depth or any(tree.truth for tree in frame.trees)
            path = out.joinpath(*folders, f"{places.stem(frame)}.json")
            write_text(path, json.dumps(content, indent=2))
    lost = "left out: depth pictures and metric values of {} frames, for which labelme has no place"
    return [lost.format(measured)] if measured else []


def _shapes(frame: FrameRecord, tree: TreeRecord, group: int) -> list[dict[str, Any]]:
    marks = (("ignore", tree.marked), ("crowd", tree.crowd))
    flags = {name: True for name, is_set in marks if is_set}
    parts = outlines(frame, tree)
    kind = "polygon" if parts else "rectangle"
    corners = [part.tolist() for part in parts] or [tree.box_px.reshape(2, 2).tolist()]
    shapes = [_shape("tree", kind, points, group, flags) for points in corners]
    for name, (x, y, flag) in zip(KEYPOINT_NAMES, tree.keypoints.tolist(), strict=True):
        if flag:
            hidden = {"hidden": True} if flag == _HIDDEN else {}
            shapes.append(_shape(name, "point", [[x, y]], group, hidden))
    return shapes


def _shape(
    label: str, kind: str, points: list[Any], group: int, flags: dict[str, bool]
) -> dict[str, Any]:
    return {
        "label": label,
        "points": points,
        "group_id": group,
        "description": "",
        "shape_type": kind,
        "flags": flags,
        "mask": None,
    }
