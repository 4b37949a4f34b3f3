"""Check the images given to a detector and convert them to the model's uint8 input."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.arrays import UInt8
from basetree.errors import InputError
from calib.depth.convention import refuse_millimetres
from edgetree.model_file.inputs_outputs import COLOUR, DEPTH
from edgetree.model_file.manifest import Manifest

_LARGEST_SIDE_PX: Final = 32767


def check_image(
    image: object, name: str, manifest: Manifest, kind: str | None = None
) -> NDArray[Any]:
    """Check that an image suits the model.

    Args:
        image: An image as for `TreeDetector.detect`.
        name: Name of the image in error messages.
        manifest: The model's manifest.
        kind: Of a model of both inputs which one this is, `colour` or `depth`.

    Returns:
        The image as a contiguous array.

    Raises:
        InputError: `image` is not an array, has another shape or dtype, is empty or too large, or
            has negative depths or such as look like millimetres.
    """
    if not isinstance(image, np.ndarray) or isinstance(image, np.ma.MaskedArray):
        why = "; cv2.imread gives None for a file that it cannot read" if image is None else ""
        raise InputError(f"{name} is a {type(image).__name__}: expected a plain numpy array{why}")
    found = f"{image.dtype} {image.shape}"
    if (kind or next(iter(manifest.graph_inputs))) == COLOUR:
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise InputError(f"{name} is {found}: expected uint8 (H, W, 3) BGR")
    elif image.ndim != 2 or not (image.dtype == np.uint8 or image.dtype.kind == "f"):
        fix = ""
        if image.ndim == 2 and image.dtype.kind in "iu":
            fix = "; millimetres become metres by `image.astype(numpy.float32) / 1000`"
        raise InputError(
            f"{name} is {found}: expected float (H, W) metres or uint8 (H, W) encoded{fix}"
        )
    if image.size == 0:
        raise InputError(f"{name} is {found}: expected at least one pixel")
    if max(image.shape) > _LARGEST_SIDE_PX:
        raise InputError(f"{name} is {found}: expected at most {_LARGEST_SIDE_PX} px a side")
    if image.dtype.kind == "f":
        _check_depth(image, name)
    return np.ascontiguousarray(image)


def _check_depth(depth_m: NDArray[Any], name: str) -> None:
    """Reject negative depths, but for minus infinity, a sign of no reading; and millimetres."""
    negative = depth_m < 0
    if negative.any():
        lowest = depth_m[negative & np.isfinite(depth_m)].min(initial=0)
        if lowest < 0:
            raise InputError(
                f"{name} has negative depths, {lowest:g} m the lowest: expected metres in"
                " front of the camera, and 0.0, NaN or an infinity where there is no reading"
            )
    refuse_millimetres(depth_m, name)


def by_input(images: UInt8, manifest: Manifest) -> dict[str, UInt8]:
    """Prepared images of a batch by the graph's inputs.

    Args:
        images: (B, H, W, 3) or (B, H, W) uint8; of a model of both (B, H, W, 4) with the depth as
            the last channel.
        manifest: The model's manifest.
    """
    if not manifest.takes_both:
        return {manifest.input.name: images}
    parts = {COLOUR: images[..., :3], DEPTH: images[..., 3]}
    return {name: np.ascontiguousarray(part) for name, part in parts.items()}


def to_bytes(image: NDArray[Any], encoding: calib.DepthEncoding | None) -> UInt8:
    """Convert a checked image to uint8, without resizing it.

    Args:
        image: The result of `check_image`.
        encoding: Encoding of the depth model; None for an rgb model.

    Returns:
        uint8 (H, W, 3) or (H, W); depth in metres is encoded.
    """
    if encoding is None or image.dtype == np.uint8:
        return image
    with np.errstate(over="ignore"):  # float64 values beyond float32 become inf, no reading
        depth_m = image.astype(np.float32, copy=False)
    return calib.encode_depth(depth_m, encoding)
