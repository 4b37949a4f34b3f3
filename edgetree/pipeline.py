"""One frame through detection and, where depth and a camera are known, measurement."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from calib import PinholeCamera
from edgetree.detections import TreeDetections
from edgetree.errors import InputError
from edgetree.runtime import TreeDetector
from edgetree.sources import Frame

if TYPE_CHECKING:
    from edgetree.measure import TreeMeasurement

__all__ = ["FrameResult", "process"]


@dataclass(frozen=True, eq=False)
class FrameResult:
    """What came of one frame.

    Attributes:
        frame: the frame.
        trees: its trees, best first.
        measurements: one for each tree; None if nothing could be measured.
        metres_need: what measuring needs that was not given; None if it was measured.
        detect_ms: time for detection, from the image in memory to the trees.
    """

    frame: Frame
    trees: TreeDetections
    measurements: list[TreeMeasurement] | None
    metres_need: str | None
    detect_ms: float


def process(
    frame: Frame,
    detector: TreeDetector,
    camera: PinholeCamera | None = None,
    up_camera: tuple[float, float, float] | None = None,
) -> FrameResult:
    """Detect the trees of a frame, and measure them if it has depth and the camera is known.

    Args:
        frame: what to look at.
        detector: the model.
        camera: what took the frame and its depth.
        up_camera: direction away from gravity in the camera's frame, as `measure_trees` takes it.

    Raises:
        InputError: the model needs depth and the frame has none, or the reverse; or the camera
            is for another image size.
    """
    is_depth = detector.manifest.modality == "depth"
    image = frame.depth_m if is_depth else frame.image
    if image is None:
        raise InputError(f"{frame.path} gives no {'depth' if is_depth else 'colour'} for the model")
    height, width = image.shape[:2]
    if camera is not None and (camera.width, camera.height) != (width, height):
        raise InputError(
            f"the camera is for {camera.width}x{camera.height} px:"
            f" expected {width}x{height} px, as {frame.path}"
        )
    start = time.perf_counter()
    trees = detector.detect(image)
    detect_ms = (time.perf_counter() - start) * 1000
    if frame.depth_m is None or camera is None:
        return FrameResult(frame, trees, None, _missing(frame, camera), detect_ms)
    from edgetree.measure import measure_trees

    measurements = measure_trees(trees, frame.depth_m, camera, up_camera=up_camera)
    return FrameResult(frame, trees, measurements, None, detect_ms)


def _missing(frame: Frame, camera: PinholeCamera | None) -> str:
    """What the user can add to get metres."""
    if frame.depth_m is None:
        extra = "" if camera is not None else " and --camera"
        return f"need depth: pass --depth{extra}"
    return "need the camera: pass --camera"
