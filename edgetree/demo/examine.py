"""One model over frames whose truth is known: detect, measure, match, draw."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera
from edgetree.demo.comparison import FrameComparison, TrueTree, compare_trees
from edgetree.demo.matching import Match, match_boxes
from edgetree.demo.result import Picture
from edgetree.detections import TreeDetections
from edgetree.draw import draw_trees, picture_of_depth
from edgetree.measure import Estimate, TreeMeasurement, measure_trees
from edgetree.runtime import TreeDetector

__all__ = ["DemoFrame", "Examination", "examine", "examine_frame"]

_JPEG_QUALITY: Final = 82


@dataclass(frozen=True, eq=False)
class DemoFrame:
    """A frame with everything that is known of it.

    Attributes:
        name: for people.
        image: (H, W, 3) uint8 BGR.
        depth_m: (H, W) float32 metres along the optical axis, 0.0 = no reading.
        camera: of both, for H x W pixels.
        up_camera: (3,) unit vector against gravity in the camera's frame; None if unknown.
        trees: the labelled trees.
    """

    name: str
    image: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    camera: PinholeCamera
    up_camera: NDArray[np.float64] | None
    trees: tuple[TrueTree, ...]


@dataclass(frozen=True)
class Examination:
    """What one model made of the frames, in their order."""

    comparisons: tuple[FrameComparison, ...]
    pictures: tuple[Picture, ...]


def examine(
    detector: TreeDetector,
    frames: Sequence[DemoFrame],
    on_frame: Callable[[], None] = lambda: None,
) -> Examination:
    """Run a model over frames; `on_frame` is called after each."""
    comparisons, pictures = [], []
    for frame in frames:
        comparison, picture = examine_frame(detector, frame)
        comparisons.append(comparison)
        pictures.append(picture)
        on_frame()
    return Examination(tuple(comparisons), tuple(pictures))


def examine_frame(detector: TreeDetector, frame: DemoFrame) -> tuple[FrameComparison, Picture]:
    """Detect and measure one frame, hold it against the truth and draw it."""
    modality = detector.manifest.modality
    seen: NDArray[Any] = frame.depth_m if modality == "depth" else frame.image
    trees = detector.detect(seen)
    measurements = measure_trees(trees, frame.depth_m, frame.camera, up_camera=frame.up_camera)
    truths = sorted(frame.trees, key=lambda tree: tree.distance_m)
    true_px = np.array([tree.box_px for tree in truths]).reshape(-1, 4)
    matches = match_boxes(trees.boxes_px, true_px)
    comparison = compare_trees(frame.name, truths, matches, trees.scores.tolist(), measurements)
    base = picture_of_depth(frame.depth_m) if modality == "depth" else frame.image
    labels = _labels(matches, measurements)
    return comparison, _picture(frame.name, modality, base, trees, labels)


def _labels(matches: Sequence[Match], measurements: Sequence[TreeMeasurement]) -> list[list[str]]:
    """Per detection its number in the report's table and its metres; "?" for no labelled tree."""
    numbers = {match.detection: str(match.truth + 1) for match in matches}
    return [
        [f"{numbers.get(index, '?')}  {_diameter_text(measured)}", _place_text(measured)]
        for index, measured in enumerate(measurements)
    ]


def _diameter_text(measured: TreeMeasurement) -> str:
    value = measured.diameter_m
    if not isinstance(value, Estimate):
        return "no diameter"
    return f"Ø {value.value * 100:.0f} ± {value.std * 100:.0f} cm"


def _place_text(measured: TreeMeasurement) -> str:
    parts = []
    if isinstance(measured.cut_height_m, Estimate):
        parts.append(f"cut {measured.cut_height_m.value * 100:.0f} cm")
    if isinstance(measured.distance_m, Estimate):
        parts.append(f"{measured.distance_m.value:.1f} m away")
    return ", ".join(parts)


def _picture(
    name: str,
    modality: str,
    base: NDArray[np.uint8],
    trees: TreeDetections,
    labels: Sequence[Sequence[str]],
) -> Picture:
    drawn = draw_trees(base, trees, labels)
    done, data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not done:
        raise ValueError(f"a picture of shape {drawn.shape} cannot be encoded as JPEG")
    return Picture(name, modality, data.tobytes(), drawn.shape[1], drawn.shape[0])
