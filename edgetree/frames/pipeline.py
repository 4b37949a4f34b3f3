"""Process one frame: detection and, with depth and a camera, measurement."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import CameraError, PinholeCamera
from edgetree.detections import TreeDetections
from edgetree.frames.rig import Rig
from edgetree.frames.sources import Frame, FrameSource, open_source
from edgetree.runtime.detector import TreeDetector

if TYPE_CHECKING:
    from edgetree.measure import MeasureSettings, TreeMeasurement

__all__ = [
    "FoundTrees",
    "FrameResult",
    "image_for",
    "measure_frame",
    "open_frames",
    "process",
    "readable",
]


@dataclass(frozen=True, eq=False)
class FoundTrees:
    """The trees of a frame, from a model or from a mask image.

    Attributes:
        trees: N trees.
        numbers: number of each tree in tables and pictures.
        masks: (N, H, W) bool masks from a mask image; None for trees from a model.
    """

    trees: TreeDetections
    numbers: tuple[int, ...]
    masks: NDArray[np.bool_] | None = None

    @classmethod
    def detected(cls, trees: TreeDetections) -> FoundTrees:
        """Trees from a model, numbered from 1."""
        return cls(trees, tuple(range(1, len(trees) + 1)))

    def mask(self, index: int) -> NDArray[np.bool_] | None:
        """The mask of tree `index`, (H, W) bool; None if there are no masks."""
        if self.masks is not None:
            return np.asarray(self.masks[index])
        return None if self.trees.masks is None else self.trees.mask(index)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """The result of one frame.

    Attributes:
        frame: the frame.
        found: its trees.
        measurements: one for each tree; None if depth or camera are missing.
        metres_need: which options measuring needs; None if the trees were measured.
        detect_ms: time of the detection, including resizing; 0 for trees from a mask image.
        camera: the camera of the measurement, scaled to the frame; None if it is not known.
        scaling: a note if the camera was scaled to the frame's size, else None.
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
        """The detections of `found`."""
        return self.found.trees


def open_frames(
    source: Path,
    depth: Path | None = None,
    *,
    rig: Rig | None = None,
    detector: TreeDetector | None = None,
) -> FrameSource:
    """Open the frames of a source for a model.

    For a depth model, the source consists of depth images if `depth` is not given.

    Args:
        source: an image, a folder of images, or a video.
        depth: depth image or folder of depth images, as for `open_source`.
        rig: the cameras and the unit of the depth.
        detector: the model; None if the trees come from a mask image.

    Raises:
        InputError: as for `open_source`.
    """
    depth_only = depth is None and detector is not None and detector.manifest.takes_depth
    return open_source(source, depth, depth_only=depth_only, rig=rig)


def readable(frames: FrameSource, on_error: Callable[[Exception], None]) -> Iterator[Frame]:
    """Yield the frames that can be read.

    Args:
        frames: the frames.
        on_error: called with the error of each frame that cannot be read.
    """
    iterator = iter(frames)
    while True:
        try:
            frame = next(iterator)
        except StopIteration:
            return
        except InputError as error:
            on_error(error)
            continue
        yield frame


def image_for(detector: TreeDetector, frame: Frame) -> NDArray[Any]:
    """The image of a frame that the model takes.

    Returns:
        Colour, (H, W, 3) uint8 BGR, or depth, (H, W) float32 metres.

    Raises:
        InputError: the frame does not have it.
    """
    takes_depth = detector.manifest.takes_depth
    image = frame.depth_m if takes_depth else frame.image
    if image is None:
        missing = "depth" if takes_depth else "colour image"
        raise InputError(f"{frame.path} has no {missing}: expected one, as the model takes it")
    return image


def process(
    frame: Frame,
    detector: TreeDetector,
    rig: Rig,
    settings: MeasureSettings | None = None,
) -> FrameResult:
    """Detect the trees of a frame, and measure them if depth and camera are known.

    Args:
        frame: the frame.
        detector: the model.
        rig: the cameras that took the frame.
        settings: settings of the measurement; the defaults if None.

    Raises:
        InputError: the frame does not have the kind of image that the model takes.
        CameraError: the camera is for another aspect ratio.
    """
    image = image_for(detector, frame)
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
    """Measure the given trees of a frame, if depth and camera are known.

    If the frame's depth is unusable, each measurement is a failure with the reason.

    Args:
        frame: the frame.
        found: its trees.
        rig: the cameras that took the frame.
        settings: settings of the measurement; the defaults if None.
        detect_ms: time of the detection, for the result.

    Raises:
        CameraError: the camera is for another aspect ratio.
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
    """The rig's camera, scaled to the frame; errors name the frame."""
    try:
        return rig.camera_for(width, height)
    except CameraError as error:
        raise CameraError(f"{frame.path}: {error}") from error


def _scaling(given: PinholeCamera | None, used: PinholeCamera | None) -> str | None:
    """A note if the camera was scaled."""
    if given is used or given is None or used is None:
        return None
    return (
        f"the camera is for {given.width}x{given.height} px:"
        f" scaled to {used.width}x{used.height} px, like the image"
    )


def _missing(frame: Frame, camera: PinholeCamera | None) -> str | None:
    """The options to add for measurements; None if nothing is missing."""
    if frame.depth_m is None:
        extra = "" if camera is not None else " and --camera"
        return f"need depth: pass --depth{extra}"
    return "need the camera: pass --camera" if camera is None else None
