"""Colour and depth of one frame, for a model that takes both or either."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.arrays import UInt8
from basetree.errors import InputError
from edgetree.detections import OneImage, UnlikeTraining
from edgetree.model_file.inputs_outputs import COLOUR, DEPTH
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.image_shift import unlike_training
from edgetree.runtime.input_images import check_image, to_bytes

_LEAST_SHOWN_PERCENT: Final = 1.0
"""Share of a picture that is not black, or of a depth image with a reading, below which it shows
nothing."""


@dataclass(frozen=True, eq=False)
class ColourAndDepth:
    """The images of one frame, of the same camera and size.

    Attributes:
        image: (H, W, 3) uint8 BGR; None if there is none.
        depth_m: (H, W) float metres along the optical axis, or uint8 as encoded in the manifest;
            None if there is none.
        no_image: Why there is no colour image, for results.
        no_depth: Why there is no depth, likewise.
    """

    image: NDArray[Any] | None
    depth_m: NDArray[Any] | None
    no_image: str = "there is no colour image"
    no_depth: str = "there is no depth"


FrameImage: TypeAlias = NDArray[Any] | ColourAndDepth
"""What a model takes of a frame."""


@dataclass(frozen=True, eq=False)
class PreparedImages:
    """A frame as the network takes it.

    Attributes:
        letterbox: How the frame is fitted into the input.
        planes: (H, W, 3) or (H, W) uint8 for each of the graph's inputs, in their order. Of both,
            an image that is left out shows nothing.
        alone: Which image is used alone and why; None if both are.
        unlike: How the images that are used differ from those of the training, if they do clearly.
    """

    letterbox: calib.Letterbox
    planes: tuple[UInt8, ...]
    alone: OneImage | None
    unlike: UnlikeTraining | None


def depth_name(name: str) -> str:
    """What messages call the depth beside the image of a name."""
    return "depth_m" if name == "image" else f"{name}.depth_m"


def check_pair(pair: ColourAndDepth, name: str, manifest: Manifest) -> ColourAndDepth:
    """Check the images of a frame.

    Args:
        pair: The images.
        name: Name of the colour image in error messages.
        manifest: The model's manifest.

    Returns:
        The same with contiguous arrays.

    Raises:
        InputError: There is no image, an image is not what `check_image` expects, or the two have
            different sizes.
    """
    image, depth_m, depth = pair.image, pair.depth_m, depth_name(name)
    if image is None and depth_m is None:
        raise InputError(f"{name} and {depth} are None: expected at least one of them")
    if image is not None:
        image = check_image(image, name, manifest, COLOUR)
    if depth_m is not None:
        depth_m = check_image(depth_m, depth, manifest, DEPTH)
    if image is not None and depth_m is not None and image.shape[:2] != depth_m.shape:
        raise InputError(
            f"{name} is {image.shape[1]}x{image.shape[0]} px and {depth} {depth_m.shape[1]}x"
            f"{depth_m.shape[0]} px: expected one size, with the depth aligned to the image"
        )
    return ColourAndDepth(image, depth_m, pair.no_image, pair.no_depth)


def prepare_pair(
    pair: ColourAndDepth, manifest: Manifest, encoding: calib.DepthEncoding
) -> PreparedImages:
    """Resize and join the images of a frame, without one that shows nothing.

    An image is left out that is missing, black or without readings, or that is unlike those of the
    training while the other is not.

    Args:
        pair: The images, checked.
        manifest: The model's manifest.
        encoding: Its encoding of depth.
    """
    given = {COLOUR: pair.image, DEPTH: pair.depth_m}
    height, width = next(each.shape[:2] for each in given.values() if each is not None)
    targets = manifest.graph_inputs
    letterbox = calib.Letterbox.fit(width, height, manifest.input.width, manifest.input.height)
    planes: dict[str, UInt8] = {}
    gone = {COLOUR: pair.no_image, DEPTH: pair.no_depth}
    unlike: dict[str, UnlikeTraining] = {}
    statistics: dict[str, dict[str, float]] = {}
    for kind, image in given.items():
        if image is None:
            continue
        of_depth = encoding if kind == DEPTH else None
        pad_value = manifest.pad_value_of(targets[kind])
        plane = letterbox.apply(to_bytes(image, of_depth), pad_value)
        inner = plane[: letterbox.resized_height, : letterbox.resized_width]
        found = calib.picture_statistics(np.ascontiguousarray(inner), of_depth)
        if (nothing := _shows_nothing(found)) is not None:
            gone[kind] = nothing
            continue
        planes[kind], statistics[kind] = plane, found
    usual = manifest.shown(None if len(planes) == len(given) else next(iter(planes), None))
    for kind, found in statistics.items():
        if (differing := unlike_training(found, usual.training_pictures)) is not None:
            unlike[kind] = differing
    if len(planes) == len(given) and len(unlike) == 1:
        (kind,) = unlike
        gone[kind] = f"unlike the training pictures: {unlike.pop(kind)}"
        del planes[kind]
    left_out = "; ".join(reason for kind, reason in gone.items() if kind not in planes)
    alone = OneImage(next(iter(planes), "neither"), left_out) if len(planes) < len(given) else None
    shown = tuple(
        planes[kind] if kind in planes else np.full(target.image_shape, target.nothing, np.uint8)
        for kind, target in targets.items()
    )
    return PreparedImages(letterbox, shown, alone, next(iter(unlike.values()), None))


def _shows_nothing(statistics: dict[str, float]) -> str | None:
    """Why an image shows nothing, by its statistics; None if it shows something."""
    if "black_percent" in statistics:
        shown = 100 - statistics["black_percent"]
        return f"the picture is black, but for {shown:.1g} %" if _is_empty(shown) else None
    read = statistics["reading_percent"]
    return f"{read:.1g} % of the depth image has a reading in range" if _is_empty(read) else None


def _is_empty(percent: float) -> bool:
    return percent < _LEAST_SHOWN_PERCENT


def check_camera(camera: calib.PinholeCamera, image: FrameImage, name: str) -> None:
    """Raise InputError if a camera is not of a checked image's size."""
    images = (image.image, image.depth_m) if isinstance(image, ColourAndDepth) else (image,)
    height, width = next(each.shape[:2] for each in images if each is not None)
    if (camera.width, camera.height) != (width, height):
        raise InputError(
            f"{name}: the camera is for {camera.width}x{camera.height} px and the image has"
            f" {width}x{height} px: expected one size"
        )
