"""What a user hands in as an image: held against what the model takes, and made its bytes."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import calib
from edgetree.errors import InputError
from edgetree.model_file.manifest import Manifest

__all__ = ["check_image", "to_bytes"]

_LARGEST_SIDE_PX: Final = 32767


def check_image(image: object, name: str, manifest: Manifest) -> NDArray[Any]:
    """The image as a plain contiguous array, if it is one for this model.

    Args:
        image: what was handed in.
        name: what errors call it.
        manifest: of the model.

    Raises:
        InputError: not an array, another shape or dtype, no pixels or too many, a negative depth.
    """
    if not isinstance(image, np.ndarray) or isinstance(image, np.ma.MaskedArray):
        raise InputError(f"{name} is a {type(image).__name__}: expected a plain numpy array")
    found = f"{image.dtype} {image.shape}"
    if manifest.modality == "rgb":
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
            raise InputError(f"{name} is {found}: expected uint8 (H, W, 3) BGR")
    elif image.ndim != 2 or not (image.dtype == np.uint8 or image.dtype.kind == "f"):
        raise InputError(
            f"depth {name} is {found}: expected float (H, W) metres or uint8 (H, W) encoded"
        )
    if image.size == 0:
        raise InputError(f"{name} is {found}: expected at least one pixel")
    if max(image.shape) > _LARGEST_SIDE_PX:
        raise InputError(f"{name} is {found}: expected at most {_LARGEST_SIDE_PX} px a side")
    if image.dtype.kind == "f":
        _check_depth(image, name)
    return np.ascontiguousarray(image)


def _check_depth(depth_m: NDArray[Any], name: str) -> None:
    """No depth lies behind the camera; minus infinity is one way to say "no reading"."""
    negative = depth_m < 0
    if negative.any():
        lowest = depth_m[negative & np.isfinite(depth_m)].min(initial=0)
        if lowest < 0:
            raise InputError(
                f"depth {name} has negative depths, {lowest:g} m the lowest: expected metres in"
                " front of the camera, and 0.0, NaN or an infinity where there is no reading"
            )


def to_bytes(image: NDArray[Any], encoding: calib.DepthEncoding | None) -> NDArray[np.uint8]:
    """A checked image as the bytes that the model was trained on, still at its own size."""
    if encoding is None or image.dtype == np.uint8:
        return image
    with np.errstate(over="ignore"):  # beyond float32 is beyond any camera: no reading
        depth_m = image.astype(np.float32, copy=False)
    return calib.encode_depth(depth_m, encoding)
