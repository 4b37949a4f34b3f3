"""Process one frame: detection and, with depth and a camera, measurement."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import CameraError, PinholeCamera, RigidTransform
from calib.sizeless import SizelessCamera
from edgetree.detections import TreeDetections
from edgetree.frames.frame import DepthNoise, Frame
from edgetree.frames.references import NO_FOCAL_LENGTH
from edgetree.frames.rig import Rig
from edgetree.frames.turning import Turn
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.pairs import ColourAndDepth, FrameImage

if TYPE_CHECKING:
    from edgetree.measure import (
        Failure,
        MeasureSettings,
        PixelSize,
        StemViews,
        TreeMeasurement,
        Way,
    )


@dataclass(frozen=True, eq=False)
class FoundTrees:
    """The trees of a frame, from a model or from a mask image.

    Attributes:
        trees: N trees.
        numbers: Number of each tree in tables and pictures.
        masks: (N, H, W) bool masks from a mask image; None for trees from a model.
        detect_ms: Time of the detection, including resizing; 0 for trees from a mask image.
        tracks: Number of each tree's stem, the same in all frames of a stream where stems are
            followed in the picture, and None until several frames show it; None elsewhere.
    """

    trees: TreeDetections
    numbers: tuple[int, ...]
    masks: NDArray[np.bool_] | None = None
    detect_ms: float = 0.0
    tracks: tuple[int | None, ...] | None = None

    @classmethod
    def detected(cls, trees: TreeDetections, detect_ms: float = 0.0) -> FoundTrees:
        """Trees from a model, numbered from 1."""
        return cls(trees, tuple(range(1, len(trees) + 1)), detect_ms=detect_ms)

    @property
    def names(self) -> tuple[str, ...]:
        """What pictures call each tree: #12 for a followed stem, or else its number."""
        if self.tracks is None:
            return tuple(map(str, self.numbers))
        return tuple("new" if track is None else f"#{track}" for track in self.tracks)

    def mask(self, index: int) -> NDArray[np.bool_] | None:
        """The mask of tree `index`, (H, W) bool; None if there are no masks."""
        if self.masks is not None:
            return np.asarray(self.masks[index])
        return None if self.trees.masks is None else self.trees.mask(index)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """The result of one frame.

    Attributes:
        frame: The frame.
        found: Its trees.
        measurements: One for each tree; None if depth or camera are missing.
        metres_need: What measuring needs; None if the trees were measured.
        camera: The camera of the measurement, of the frame's size; None if it is not known.
        scaling: a note if the rig's camera was scaled to the frame's size, else None.
        turning: a note if the frame was turned by its vertical, else None.
        turn: The turn that makes the frame upright.
        up_camera: (3,) the vertical in the camera's frame; None if it is not given.
        settings: Settings of the measurement; None for the defaults.
    """

    frame: Frame
    found: FoundTrees
    measurements: list[TreeMeasurement] | None
    metres_need: str | None
    camera: PinholeCamera | None = None
    scaling: str | None = None
    turning: str | None = None
    turn: Turn = field(default_factory=Turn)
    up_camera: NDArray[np.float64] | None = None
    settings: MeasureSettings | None = None

    @cached_property
    def pixel_sizes(self) -> list[PixelSize | Failure]:
        """The size of each tree in the picture, which needs neither depth nor camera."""
        from edgetree.measure import pixel_sizes

        turn, masks, measured = self.turn, self.found.masks, self.measurements
        if turn and masks is not None:
            masks = np.stack([turn.picture(mask) for mask in masks])
        if turn and measured is not None:
            measured = [turn.measurement(tree) for tree in measured]
        camera = self.camera
        up = self.up_camera
        return pixel_sizes(
            turn.trees(self.trees),
            turn.camera(camera) if turn and camera is not None else camera,
            masks=masks,
            up_camera=turn.directions(up) if turn and up is not None else up,
            measurements=measured,
            settings=self.settings,
        )

    @property
    def trees(self) -> TreeDetections:
        """The detections of `found`."""
        return self.found.trees

    @property
    def detect_ms(self) -> float:
        """Time of the detection, including resizing; 0 for trees from a mask image."""
        return self.found.detect_ms


def has_image_for(detector: TreeDetector, frame: Frame) -> bool:
    """Whether a frame has the image that the model takes, or one of the two."""
    manifest = detector.manifest
    by_colour = frame.image is not None and not manifest.takes_depth
    return by_colour or (frame.depth_m is not None and manifest.modality != "rgb")


def image_for(detector: TreeDetector, frame: Frame) -> FrameImage:
    """The image of a frame that the model takes.

    Returns:
        Colour, (H, W, 3) uint8 BGR, or depth, (H, W) float32 metres; for a model of both the two,
        of which one may be None.

    Raises:
        InputError: The frame does not have it.
    """
    manifest = detector.manifest
    if not has_image_for(detector, frame):
        missing = {"rgb": "colour image", "depth": "depth"}.get(manifest.modality, "image")
        raise InputError(f"{frame.where} has no {missing}: expected one, as the model takes it")
    depth_m = frame.depth_m if frame.filled_depth_m is None else frame.filled_depth_m
    if manifest.takes_both:
        return _both(frame, depth_m)
    image = depth_m if manifest.takes_depth else frame.image
    assert image is not None
    return image


def _both(frame: Frame, depth_m: NDArray[np.float32] | None) -> ColourAndDepth:
    """Colour and depth of a frame, without a depth that is unusable beside its colour."""
    if frame.depth_fault is None or frame.image is None:
        return ColourAndDepth(frame.image, depth_m)
    return ColourAndDepth(frame.image, None, no_depth=frame.depth_fault)


def process(
    frame: Frame,
    detector: TreeDetector,
    rig: Rig,
    settings: MeasureSettings | None = None,
    views: StemViews | None = None,
) -> FrameResult:
    """Detect the trees of a frame, and measure them if depth and camera are known.

    Args:
        frame: The frame.
        detector: The model.
        rig: The cameras that took the frame. Its camera takes the place of the frame's own; its
            vertical is for frames without one.
        settings: Settings of the measurement; the defaults if None.
        views: Earlier views of the stems of a stream, for its frames with poses and without depth.

    Raises:
        InputError: The frame does not have the kind of image that the model takes.
        CameraError: The camera is for another aspect ratio.
    """
    return measure_frame(frame, find_trees(frame, detector, rig), rig, settings, views)


def find_trees(frame: Frame, detector: TreeDetector, rig: Rig | None = None) -> FoundTrees:
    """Detect the trees of a frame: the first half of `process`.

    Args:
        frame: The frame.
        detector: The model.
        rig: How the camera is turned, as for `process`.

    Raises:
        InputError: The frame does not have the kind of image that the model takes.
        CameraError: The camera is for another aspect ratio.
    """
    image = image_for(detector, frame)
    rig = rig or Rig()
    turn, camera = rig.turn(frame), _camera_of_depth(frame, rig)
    if camera is not None:
        camera = turn.camera(camera)
    start = time.perf_counter()
    trees = turn.back.trees(detector.detect(_turned(image, turn), camera=camera))
    return FoundTrees.detected(trees, (time.perf_counter() - start) * 1000)


def _camera_of_depth(frame: Frame, rig: Rig) -> PinholeCamera | None:
    """The camera of a frame with depth that can be used; None without depth or camera."""
    if frame.depth_m is None or frame.depth_fault is not None:
        return None
    height, width = frame.depth_m.shape
    return _camera(frame, rig, width, height)


def _camera(frame: Frame, rig: Rig, width: int, height: int) -> PinholeCamera | None:
    """The camera of pictures of this size; raises CameraError with the frame's name."""
    try:
        return rig.camera_for(width, height) or frame.camera
    except CameraError as error:
        raise CameraError(f"{frame.where}: {error}") from error


def _turned(image: FrameImage, turn: Turn) -> FrameImage:
    if not isinstance(image, ColourAndDepth):
        return turn.picture(image)
    both = (image.image, image.depth_m)
    colour, depth_m = (None if each is None else turn.picture(each) for each in both)
    return replace(image, image=colour, depth_m=depth_m)


def measure_frame(
    frame: Frame,
    found: FoundTrees,
    rig: Rig,
    settings: MeasureSettings | None = None,
    views: StemViews | None = None,
) -> FrameResult:
    """Measure the given trees of a frame, if depth and camera are known: the other half.

    If the frame's depth is unusable, each measurement is a failure with the reason.

    Args:
        frame: The frame.
        found: Its trees.
        rig: The cameras, as for `process`.
        settings: Settings of the measurement; the defaults if None.
        views: Earlier views of the stems, as for `process`.

    Raises:
        CameraError: The camera is for another aspect ratio.
    """
    camera = _camera(frame, rig, found.trees.image_width, found.trees.image_height)
    ways: list[Way] = []
    if frame.depth_m is None and rig.references is not None:
        camera = rig.references.camera_for(frame, camera)
        ways = rig.references.ways(frame, rig.turn(frame))
    if frame.depth_m is None and frame.pose is not None and views is not None:
        upright = RigidTransform(rig.turn(frame).back.rotation, np.zeros(3))
        ways.append(views.at(upright.then(frame.pose)))
    need = _needed(frame, camera, ways)
    up_camera = rig.vertical_of(frame, camera)
    measurements = None
    if need is None and camera is not None:
        if frame.depth_m is not None:
            rig.tell_lens(frame)
            rig.tell_depth()
        inputs = _Inputs(frame, camera, found, rig, up_camera)
        measurements = inputs.measured(ways, settings)
    scaling, turning = _scaling(rig.camera, camera), _turning(frame, rig)
    more = (camera, scaling, turning, rig.turn(frame), up_camera, settings)
    return FrameResult(frame, found, measurements, need, *more)


@dataclass(frozen=True, eq=False)
class _Inputs:
    """What a frame is measured with."""

    frame: Frame
    camera: PinholeCamera
    found: FoundTrees
    rig: Rig
    up_camera: NDArray[np.float64] | None

    def measured(self, ways: list[Way], settings: MeasureSettings | None) -> list[TreeMeasurement]:
        """The measurement of each tree, by the depth or by other ways to distances."""
        from edgetree.measure import (
            MeasureSettings,
            TreeMeasurement,
            measure_trees,
            measure_without_depth,
        )

        frame, rig, found, camera = self.frame, self.rig, self.found, self.camera
        if frame.depth_fault is not None:
            return [TreeMeasurement.failed(frame.depth_fault) for _ in range(len(found.trees))]
        turn, masks, mounting, up = rig.turn(frame), found.masks, rig.mounting, self.up_camera
        if turn:
            masks = None if masks is None else np.stack([turn.picture(mask) for mask in masks])
            up = None if up is None else turn.directions(up)
            mounting = None if mounting is None else turn.mounting(mounting)
            camera = turn.camera(camera)
        rig.tell_assumed(camera, up is not None, has_depth=frame.depth_m is not None)
        given: dict[str, Any] = {
            "masks": masks,
            "up_camera": up,
            "mounting": mounting,
            "settings": with_noise(settings, frame.depth_noise),
            "rig_uncertainty": rig.known_uncertainty(),
        }
        trees = turn.trees(found.trees)
        if frame.depth_m is None:
            measured = measure_without_depth(trees, camera, ways, **given)
        else:
            sparse = frame.filled_depth_m is not None
            depth_m = turn.picture(frame.depth_m)
            measured = measure_trees(trees, depth_m, camera, sparse=sparse, **given)
        if turn:
            measured = [turn.back.measurement(tree) for tree in measured]
        if frame.cloud_m is None:
            return measured
        from edgetree.measure.slices import with_circles

        return with_circles(measured, frame.cloud_m, given["settings"] or MeasureSettings())


def with_noise(
    settings: MeasureSettings | None, noise: DepthNoise | None
) -> MeasureSettings | None:
    """The settings of the measurement, with what a frame knows of the errors of its depth."""
    if noise is None:
        return settings
    from edgetree.measure import MeasureSettings

    known = {f"depth_{name}": value for name, value in asdict(noise).items() if value is not None}
    return replace(settings or MeasureSettings(), **known)


def _turning(frame: Frame, rig: Rig) -> str | None:
    """A note if the frame was turned although the user did not say so."""
    turn = rig.turn(frame)
    if rig.rotation_of(frame) is not None or not turn:
        return None
    return (
        f"the vertical says that the camera lies on its side: pictures are turned by {turn} for"
        " the model, results are in the pixels as they are; --rotate says it otherwise"
    )


def _scaling(given: PinholeCamera | None, used: PinholeCamera | None) -> str | None:
    """A note if the rig's camera was scaled; one without a size tells it itself."""
    if given is used or given is None or used is None or isinstance(given, SizelessCamera):
        return None
    return (
        f"the camera is for {given.width}x{given.height} px:"
        f" scaled to {used.width}x{used.height} px, like the image"
    )


def _needed(frame: Frame, camera: PinholeCamera | None, ways: list[Way]) -> str | None:
    """What measuring needs; None if nothing is missing."""
    if frame.depth_m is not None:
        return "need the camera: pass --camera" if camera is None else None
    if ways:
        return None if camera is not None else f"need the camera: pass --camera; {NO_FOCAL_LENGTH}"
    other = "or without depth --camera-height or --marker"
    if frame.number is not None:
        return f"need depth with each frame; {other}"
    if frame.time_s is not None:
        return (
            "need depth, and a video has none: expected a recording with depth, or the video of a"
            f" right camera (--right); {other}"
        )
    return f"need depth: pass --depth{' and --camera' if camera is None else ''}; {other}"
