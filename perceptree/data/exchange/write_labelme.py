"""Write frames as labelme reads them: a JSON file beside each picture."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from basetree.arrays import Float64
from basetree.files.writing import write_text
from perceptree.data.coco import FrameRecord, TreeRecord
from perceptree.data.exchange.outlines import HOLES, SMALL_PARTS, outlines
from perceptree.data.exchange.places import Places
from perceptree.keypoints import KEYPOINT_NAMES

_VERSION = "5.5.0"  # of labelme, whose form this is
_HIDDEN = 1  # COCO's flag


def write_labelme(out: Path, splits: Mapping[str | None, Sequence[FrameRecord]]) -> list[str]:
    """Write a folder for each split; `group_id` joins the shapes of one tree.

    Returns:
        Messages for the user about what the form cannot hold, and pictures that do not fit.
    """
    places = Places(out, [frame for frames in splits.values() for frame in frames])
    measured, holes, parts = 0, 0, 0
    for split, frames in splits.items():
        folders = () if split is None else (split,)
        for frame in frames:
            traced = [outlines(frame, tree) for tree in frame.trees]
            holes += sum(one.fills_holes for one in traced)
            parts += sum(one.drops_parts for one in traced)
            name = places.copy(frame.image_path, *folders).rpartition("/")[2]
            content: dict[str, Any] = {
                "version": _VERSION,
                "flags": {},
                "shapes": [
                    shape
                    for group, (tree, one) in enumerate(zip(frame.trees, traced, strict=True), 1)
                    for shape in _shapes(tree, one.parts, group)
                ],
                "imagePath": name,
                "imageData": None,
                "imageHeight": frame.height,
                "imageWidth": frame.width,
            }
            measured += frame.has_depth or any(tree.truth for tree in frame.trees)
            path = out.joinpath(*folders, f"{places.stem(frame)}.json")
            write_text(path, json.dumps(content, indent=2))
    messages = {
        "left out: depth pictures and metric values of {} frames, for which labelme has no place": (
            measured
        ),
        HOLES: holes,
        SMALL_PARTS: parts,
    }
    return [text.format(count) for text, count in messages.items() if count] + places.notes()


def _shapes(tree: TreeRecord, parts: list[Float64], group: int) -> list[dict[str, Any]]:
    marks = (("ignore", tree.marked), ("crowd", tree.crowd))
    flags = {name: True for name, is_set in marks if is_set}
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
