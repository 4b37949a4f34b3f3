"""Find how a Detectron2 network normalises its input, and where its bottlenecks have the stride."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Literal

from perceptree.errors import CheckpointError
from perceptree.models.presets import IMAGENET_MEAN, IMAGENET_STD, UNIT_STD
from perceptree.models.weights.reading import Tensors

StrideIn = Literal["auto", "1x1", "3x3"]
PixelStd = Literal["auto", "unit", "imagenet"]

_MEAN, _STD = "pixel_mean", "pixel_std"
_MEAN_TOLERANCE = 1.0
_LARGEST_PIXEL = 255.0


@dataclasses.dataclass(frozen=True)
class Normalisation:
    """Input of a network, and position of its strides."""

    mean: tuple[float, ...]
    """Mean of the pixels, BGR."""
    std: tuple[float, ...]
    """Divisor of the pixels, BGR."""
    stride_in_1x1: bool
    """Whether bottlenecks have their stride in the 1x1 convolution."""
    assumed: tuple[str, ...]
    """Properties that the file does not state."""
    red_first: bool
    """Whether the network was trained on RGB, not on BGR."""


def normalisation(
    path: Path, tensors: Tensors, stride_in: StrideIn, pixel_std: PixelStd, usual_1x1: bool
) -> Normalisation:
    """Determine mean, std and position of the stride.

    In the published configurations, networks with the stride in the 1x1 convolution have a std
    of 1, and those with the stride in the 3x3 convolution have ImageNet's std.

    Args:
        path: File that an error names.
        tensors: The file's tensors by Detectron2 name.
        stride_in: Option of the user.
        pixel_std: Option of the user; other values than `auto` replace the file's.
        usual_1x1: Whether the published network has its strides in the 1x1 convolutions.

    Raises:
        CheckpointError: If the file's mean or std cannot be those of 8-bit pixels.
    """
    assumed: tuple[str, ...] = ()
    mean = _constant(path, tensors, _MEAN)
    std = _constant(path, tensors, _STD) if pixel_std == "auto" else None
    _check_plausible(path, mean, std)
    if mean is None:
        mean, assumed = IMAGENET_MEAN, ("pixel mean of ImageNet",)
    if pixel_std != "auto":
        std = UNIT_STD if pixel_std == "unit" else IMAGENET_STD
    in_1x1 = stride_in == "1x1"
    if stride_in == "auto":
        in_1x1 = usual_1x1 and (std is None or max(std) == 1.0)
        assumed += ("stride in the " + ("1x1" if in_1x1 else "3x3"),)
    if std is None:
        std = UNIT_STD if in_1x1 else IMAGENET_STD
        assumed += ("pixel std of " + ("1" if in_1x1 else "ImageNet"),)
    pairs = zip(mean, reversed(IMAGENET_MEAN), strict=True)
    red_first = all(abs(a - b) < _MEAN_TOLERANCE for a, b in pairs)
    if red_first:
        mean, std = mean[::-1], std if pixel_std != "auto" else std[::-1]
    return Normalisation(mean, std, in_1x1, assumed, red_first)


def _constant(path: Path, tensors: Tensors, name: str) -> tuple[float, ...] | None:
    """Three values of the file's configuration; None if they are missing."""
    value = tensors.get(name)
    if value is None:
        return None
    if value.numel() != 3:
        shape = tuple(value.shape)
        raise CheckpointError(f"{path}: {name} has shape {shape}, expected three values")
    return tuple(round(float(v), 4) for v in value.flatten())


def _check_plausible(
    path: Path, mean: tuple[float, ...] | None, std: tuple[float, ...] | None
) -> None:
    """Check that mean and std are those of pixels of 0 to 255, as Detectron2's are.

    A mean of 0 is accepted, a mean up to 1 is one of pixels of 0 to 1.
    """
    if mean is not None:
        in_range = all(0.0 <= value <= _LARGEST_PIXEL for value in mean)
        if not in_range or 0.0 < max(mean) <= 1.0:
            raise CheckpointError(
                f"{path}: {_MEAN} is {_listed(mean)}, expected the mean of pixels of 0 to 255,"
                f" such as {_listed(IMAGENET_MEAN)}"
            )
    if std is not None and not all(1.0 <= value <= _LARGEST_PIXEL for value in std):
        raise CheckpointError(
            f"{path}: {_STD} is {_listed(std)}, expected 1 to 255, such as 1, 1, 1 or"
            f" {_listed(IMAGENET_STD)}"
        )


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in values)
