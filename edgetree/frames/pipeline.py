"""One frame through detection and, where depth and a camera are known, measurement."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from calib import CameraError, PinholeCamera
from edgetree.detections import TreeDetections
from edgetree.errors import InputError
from edgetree.frames.rig import Rig
from edgetree.frames.sources import Frame
from edgetree.runtime.detector import TreeDetector

if TYPE_CHECKING:
    from edgetree.measure import MeasureSettings, TreeMeasurement

__all__ = ["FoundTrees", "FrameResult", "measure_frame", "process"]


@dataclass(frozen=True, eq=False)
class FoundTrees:
    """The trees of a frame, that a model found or someone else.

    Attributes:
        trees: N trees, best first.
        numbers: what each is called in tables and pictures.
        masks: (N, H, W) their pixels, in place of the masks that a model gives.
    """

    trees: TreeDetections
    numbers: tuple[int, ...]
    masks: NDArray[np.bool_] | None = None

    @classmethod
    def detected(cls, trees: TreeDetections) -> FoundTrees:
        """Those of a model, numbered from 1."""
        return cls(trees, tuple(range(1, len(trees) + 1)))

    def mask(self, index: int) -> NDArray[np.bool_] | None:
        """The pixels of tree `index`, (H, W) bool; None where nobody gives masks."""
        if self.masks is not None:
            return np.asarray(self.masks[index])
        return None if self.trees.masks is None else self.trees.mask(index)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What came of one frame.

    Attributes:
        frame: the frame.
        found: its trees.
        measurements: one for each tree; None if nothing could be measured.
        metres_need: what measuring needs that was not given; None if it was measured.
        detect_ms: time for detection, from the image in memory to the trees; 0 if they were given.
        camera: what the frame was measured with.
        scaling: what was done to fit the camera to the frame, in words; None if nothing.
    """

    frame: Frame
    found: FoundTrees
    measurements: list[TreeMeasurement] | None
    metres_need: str | None
    detect_ms: float
    camera: PinholeCamera | None
    scaling: str | None

    @property
    def trees(self) -> TreeDetections:
        """The trees alone."""
        return self.found.trees


def process(
    frame: Frame,
    detector: TreeDetector,
    rig: Rig,
    settings: MeasureSettings | None = None,
) -> FrameResult:
    """Detect the trees of a frame, and measure them if it has depth and the camera is known.

    Args:
        frame: what to look at.
        detector: the model.
        rig: what took the frame.
        settings: assumptions of the measurement.

    Raises:
        InputError: the model needs depth and the frame has none, or the reverse.
        CameraError: the camera is for images of another aspect.
    """
    is_depth = detector.manifest.modality == "depth"
    image = frame.depth_m if is_depth else frame.image
    if image is None:
        raise InputError(f"{frame.path} gives no {'depth' if is_depth else 'colour'} for the model")
    start = time.perf_counter()
    trees = detector.detect(image)
    detect_ms = (time.perf_counter() - start) * 1000
    return measure_frame(frame, FoundTrees.detected(trees), rig, settings, detect_ms)


def measure_frame(
    frame: Frame,
    found: FoundTrees,
    rig: Rig,
    settings: MeasureSettings | None = None,
    detect_ms: float = 0.0,
) -> FrameResult:
    """Measure trees that are known, if the frame has depth and the camera is known.

    Where the depth is not to be believed, each tree's measurement says so.

    Args:
        frame: what to look at.
        found: its trees.
        rig: what took the frame.
        settings: assumptions of the measurement.
        detect_ms: what finding the trees took.

    Raises:
        CameraError: the camera is for images of another aspect.
    """
    trees = found.trees
    camera = _camera_of(frame, rig, trees.image_width, trees.image_height)
    measurements = None
    missing = _missing(frame, camera)
    if frame.depth_m is not None and camera is not None:
        measurements = _measure(frame, frame.depth_m, camera, found, rig, settings)
    scaling = _scaling(rig.camera, camera)
    return FrameResult(frame, found, measurements, missing, detect_ms, camera, scaling)


def _measure(
    frame: Frame,
    depth_m: NDArray[np.float32],
    camera: PinholeCamera,
    found: FoundTrees,
    rig: Rig,
    settings: MeasureSettings | None,
) -> list[TreeMeasurement]:
    from edgetree.measure import TreeMeasurement, measure_trees

    if frame.depth_fault is not None:
        return [TreeMeasurement.failed(frame.depth_fault) for _ in range(len(found.trees))]
    return measure_trees(
        found.trees,
        depth_m,
        camera,
        masks=found.masks,
        up_camera=rig.up_camera,
        mounting=rig.mounting,
        settings=settings,
    )


def _camera_of(frame: Frame, rig: Rig, width: int, height: int) -> PinholeCamera | None:
    """The rig's camera for this frame; an error names the frame."""
    try:
        return rig.camera_for(width, height)
    except CameraError as error:
        raise CameraError(f"{frame.path}: {error}") from error


def _scaling(given: PinholeCamera | None, used: PinholeCamera | None) -> str | None:
    """How the camera for the frame differs from the one that was given."""
    if given is used or given is None or used is None:
        return None
    return (
        f"the camera is for {given.width}x{given.height} px:"
        f" scaled to {used.width}x{used.height} px, as the image"
    )


def _missing(frame: Frame, camera: PinholeCamera | None) -> str | None:
    """What the user can add to get metres."""
    if frame.depth_m is None:
        extra = "" if camera is not None else " and --camera"
        return f"need depth: pass --depth{extra}"
    return "need the camera: pass --camera" if camera is None else None
