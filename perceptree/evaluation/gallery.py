"""Example images for the report: cut-outs of single trees with label and detection."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pycocotools import mask as coco_mask

from basetree.page.parts import Jpeg, jpeg_of
from calib import box_iou
from perceptree.data import FrameRecord, TreeRecord, read_frame
from perceptree.drawing import Colour, Picture, draw_trees
from perceptree.errors import DatasetError
from perceptree.evaluation.matching import DISPLAY_SCORE, Pair
from perceptree.evaluation.metrics import Measured
from perceptree.evaluation.predictions import FramePrediction, read_ahead

Float = NDArray[np.floating[Any]]

TRUTH: Colour = (90, 220, 90)
FOUND: Colour = (30, 150, 255)
_PER_GALLERY = 8
_MIN_MENTIONED_OVERLAP = 0.1
_PER_FRAME = 2
_CROP_PX = (330, 440)
_MARGIN_SHARE = 0.3
_MIN_REGION_PX = 90
_LINE_WEIGHT, _POINT_WEIGHT = 4.0, 2.6


class ExampleImage(NamedTuple):
    """An example image and its description."""

    jpeg: Jpeg
    caption: str


@dataclass(frozen=True)
class _Case:
    """What to show: a frame, a tree (None for a false positive), a row (None for a missed tree)."""

    frame: int
    tree: int | None
    row: int | None
    caption: str


def example_images(measured: Measured) -> dict[str, list[ExampleImage]]:
    """Make the example images, at most eight per gallery and two per frame.

    Returns:
        "best" and "worst": matched trees by fit. "missed": missed trees, largest first. "invented":
        false positives, highest score first.
    """
    pairs = measured.matches.found
    fits = sorted(((_fit(measured, pair), index) for index, pair in enumerate(pairs)), reverse=True)
    found = [
        _Case(
            pairs[index].frame,
            pairs[index].tree,
            pairs[index].row,
            _found_caption(measured, index, fit),
        )
        for fit, index in fits
    ]
    best = _first(found)
    chosen = {
        "best": best,
        "worst": _first([case for case in reversed(found) if case not in best]),
        "missed": _first(_missed(measured)),
        "invented": _first(_invented(measured)),
    }
    return {
        name: list(read_ahead(lambda case: _make_example(measured, case), cases))
        for name, cases in chosen.items()
    }


def _fit(measured: Measured, pair: Pair) -> float:
    """Return the mean of box IoU, mask IoU and keypoint similarity, as far as known."""
    known = [
        measured.scorer.overlap(kind, pair.frame, pair.tree, pair.row)
        for kind in ("segm", "keypoints")
    ]
    fits = [pair.iou, *(fit for fit in known if fit is not None)]
    return sum(fits) / len(fits)


def _found_caption(measured: Measured, index: int, fit: float) -> str:
    pair, errors = measured.matches.found[index], measured.errors
    parts = [f"score {measured.predictions[pair.frame].scores[pair.row]:.2f}", f"fit {fit:.2f}"]
    if errors is not None:
        cut, width = errors.of(0, "distance")[index], errors.width[index]
        parts += [f"cut {cut:.1f} px off"] if np.isfinite(cut) else []
        parts += [f"diameter {width:+.1f} px"] if np.isfinite(width) else []
    tree = measured.store.frames[pair.frame].trees[pair.tree]
    return ", ".join([*parts, *_describe_label(tree)])


def _describe_label(tree: TreeRecord) -> list[str]:
    """Return what the label tells about a tree, for the caption."""
    facts = [] if tree.species is None else [tree.species]
    if "distance_m" in tree.truth:
        facts.append(f"{tree.truth['distance_m']:.1f} m away")
    if "visible_fraction" in tree.truth:
        facts.append(f"{tree.truth['visible_fraction']:.0%} visible")
    return facts


def _missed(measured: Measured) -> list[_Case]:
    cases = []
    for number, tree_index in measured.matches.missed:
        tree, found = measured.store.frames[number].trees[tree_index], measured.predictions[number]
        width, height = tree.box_px[2:] - tree.box_px[:2]
        near = _nearest(tree.box_px, found.boxes[found.scores >= DISPLAY_SCORE], "a detection")
        caption = ", ".join([f"box {width:.0f}x{height:.0f} px", *_describe_label(tree), *near])
        cases.append((width * height, _Case(number, tree_index, None, caption)))
    return [case for _, case in sorted(cases, key=lambda entry: -entry[0])]


def _invented(measured: Measured) -> list[_Case]:
    cases = []
    for number, row in measured.matches.invented:
        found = measured.predictions[number]
        score = float(found.scores[row])
        boxes = np.array([tree.box_px for tree in measured.store.frames[number].trees])
        near = _nearest(found.boxes[row], boxes.reshape(-1, 4), "a label")
        cases.append((score, _Case(number, None, row, ", ".join([f"score {score:.2f}", *near]))))
    return [case for _, case in sorted(cases, key=lambda entry: -entry[0])]


def _nearest(box: Float, others: Float, name: str) -> list[str]:
    """Return a caption of the largest overlap with other boxes, if it is worth mentioning."""
    most = float(box_iou(box, others).max(initial=0.0))
    return [f"overlaps {name} by {most:.2f}"] if most >= _MIN_MENTIONED_OVERLAP else []


def _first(cases: Sequence[_Case]) -> list[_Case]:
    """The first cases, with a limit per frame."""
    chosen: list[_Case] = []
    for case in cases:
        if sum(other.frame == case.frame for other in chosen) < _PER_FRAME:
            chosen.append(case)
        if len(chosen) == _PER_GALLERY:
            break
    return chosen


def _make_example(measured: Measured, case: _Case) -> ExampleImage:
    frame = measured.store.frames[case.frame]
    found = measured.predictions[case.frame]
    x0, y0, x1, y1 = _region(frame, found, case)
    panels = []
    for picture in _pictures(frame, measured.store.spec.modality):
        scale = _CROP_PX[0] / (x1 - x0)
        crop = cv2.resize(picture[y0:y1, x0:x1], _CROP_PX, interpolation=cv2.INTER_LINEAR)
        panels.append(_draw_case(np.asarray(crop, np.uint8), frame, found, case, (x0, y0), scale))
    drawn = jpeg_of(np.concatenate(panels, axis=1))
    return ExampleImage(drawn, f"{frame.image_path.name}: {case.caption}")


def _pictures(frame: FrameRecord, modality: str) -> Iterator[Picture]:
    """Yield the colour image, if there is one, and for models with depth the depth image."""
    try:
        yield read_frame(frame, "rgb")
    except DatasetError:
        if modality != "depth":
            raise
    if modality != "rgb":
        yield picture_of_grey(read_frame(frame, "depth"))


def picture_of_grey(depth8: NDArray[np.uint8]) -> Picture:
    """Colour an 8-bit depth image.

    Args:
        depth8: (H, W) uint8.

    Returns:
        (H, W, 3) BGR uint8, near pixels bright, pixels without a reading black.
    """
    return np.asarray(cv2.applyColorMap(255 - depth8, cv2.COLORMAP_BONE), np.uint8)


def _region(frame: FrameRecord, found: FramePrediction, case: _Case) -> tuple[int, int, int, int]:
    """Return the rectangle to cut out: tree and detection with a margin, at the crop's aspect
    ratio.
    """
    boxes = [] if case.tree is None else [frame.trees[case.tree].box_px]
    boxes += [] if case.row is None else [found.boxes[case.row]]
    low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
    width, height = np.maximum((high - low) * (1 + _MARGIN_SHARE), _MIN_REGION_PX)
    aspect = _CROP_PX[0] / _CROP_PX[1]
    width = min(max(width, height * aspect), frame.width, frame.height * aspect)
    size = np.array([width, width / aspect])
    corner = np.clip((low + high - size) / 2, 0, np.array([frame.width, frame.height]) - size)
    x0, y0 = (int(value) for value in corner)
    across, down = (round(float(value)) for value in size)
    return x0, y0, min(x0 + across, frame.width), min(y0 + down, frame.height)


def _draw_case(
    crop: Picture,
    frame: FrameRecord,
    found: FramePrediction,
    case: _Case,
    corner: tuple[int, int],
    scale: float,
) -> Picture:
    """Draw all boxes faintly, and outline and keypoints of the case."""
    origin = np.array(corner)

    def to_crop(points: Float) -> Float:
        return np.asarray((points - origin) * scale)

    def boxes_of(boxes: Float) -> Float:
        return to_crop(np.asarray(boxes).reshape(-1, 2, 2)).reshape(-1, 4)

    shown = found.scores >= DISPLAY_SCORE
    truths = np.array([tree.box_px for tree in frame.trees]).reshape(-1, 4)
    others = draw_trees(crop, boxes=boxes_of(truths), colour=TRUTH)
    others = draw_trees(others, boxes=boxes_of(found.boxes[shown]), colour=FOUND)
    drawn = np.asarray(cv2.addWeighted(crop, 0.5, others, 0.5, 0), np.uint8)
    if case.tree is not None:
        tree = frame.trees[case.tree]
        mask = frame.mask(tree) if tree.segmentation else None
        rings = np.column_stack([to_crop(tree.keypoints[:, :2]), tree.keypoints[:, 2] > 0])
        box = boxes_of(tree.box_px)
        drawn = _draw_instance(drawn, box, _crop_mask(mask, corner, scale), rings, TRUTH)
    if case.row is not None:
        mask = None if found.masks is None else coco_mask.decode(dict(found.masks[case.row]))
        discs = None
        if found.keypoints is not None:
            points = to_crop(found.keypoints[case.row, :, :2])
            discs = np.column_stack([points, np.full(len(points), 2)])
        box = boxes_of(found.boxes[case.row])
        drawn = _draw_instance(drawn, box, _crop_mask(mask, corner, scale), discs, FOUND)
    return drawn


def _draw_instance(
    drawn: Picture, box: Float, mask: NDArray[Any] | None, points: Float | None, colour: Colour
) -> Picture:
    drawn = draw_trees(drawn, boxes=box, masks=[mask], colour=colour, weight=_LINE_WEIGHT)
    keypoints = None if points is None else points[None]
    return draw_trees(drawn, keypoints=keypoints, weight=_POINT_WEIGHT)


def _crop_mask(
    mask: NDArray[Any] | None, corner: tuple[int, int], scale: float
) -> NDArray[Any] | None:
    """Crop a frame's mask and resize it to the crop's size."""
    if mask is None:
        return None
    x0, y0 = corner
    width, height = (round(side / scale) for side in _CROP_PX)
    part = mask[y0 : y0 + height, x0 : x0 + width].astype(np.uint8) * np.uint8(255)
    grey = cv2.resize(part, _CROP_PX, interpolation=cv2.INTER_LINEAR)
    return np.asarray(grey > 127)
