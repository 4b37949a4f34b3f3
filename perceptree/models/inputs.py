"""The images that a network takes, by the name of its input.

A network of one input takes its images as one tensor. A network of both inputs takes them by name:
`colour`, (B, H, W, 3) BGR, and `depth`, (B, H, W). Datasets, caches and evaluations keep both in
one array (B, H, W, 4), the depth last. A picture of nothing but zeros stands for no colour, and one
without any reading for no depth.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import torch
from torch import Tensor
from torch.nn import functional

from perceptree.models.spec import STRIDE_5, ModelSpec

COLOUR: Final = "colour"
DEPTH: Final = "depth"

Images = Tensor | Mapping[str, Tensor]
"""Images of a batch: a tensor, or tensors by the name of the input."""


def by_name(images: Images, spec: ModelSpec) -> dict[str, Tensor]:
    """The images of a batch by their kind, `colour` or `depth`.

    Args:
        images: As for `TreeRCNN`.
        spec: The network.

    Raises:
        ValueError: If there is no image, or one of another kind, dtype or shape than the spec's.
    """
    if isinstance(images, Tensor):
        images = _split(images, spec)
    shapes = {COLOUR: (spec.height, spec.width, 3), DEPTH: (spec.height, spec.width)}
    kinds = {"rgb": (COLOUR,), "depth": (DEPTH,), "both": (COLOUR, DEPTH)}[spec.modality]
    if not images or not set(images) <= set(kinds):
        raise ValueError(f"images are {sorted(images)}, expected {' and '.join(kinds)}")
    for name, values in images.items():
        _check(values, shapes[name])
    return dict(images)


def _split(images: Tensor, spec: ModelSpec) -> dict[str, Tensor]:
    if spec.modality != "both":
        return {COLOUR if spec.modality == "rgb" else DEPTH: images}
    _check(images, spec.image_shape)
    return {COLOUR: images[..., :3], DEPTH: images[..., 3]}


def _check(images: Tensor, expected: tuple[int, ...]) -> None:
    if tuple(images.shape[1:]) != expected or images.dtype != torch.uint8:
        raise ValueError(
            f"images are {images.dtype} of shape {tuple(images.shape)}, "
            f"expected torch.uint8 of shape (B, {', '.join(map(str, expected))})"
        )


def normalised(images: Tensor, mean: Tensor, std: Tensor | None) -> Tensor:
    """Subtract the mean and divide by the standard deviation.

    Args:
        images: uint8, (B, H, W, 3) BGR or (B, H, W) depth.
        mean: (C, 1, 1) mean per channel, in 8-bit units.
        std: (C, 1, 1) standard deviation per channel, in 8-bit units; None for 1.

    Returns:
        (B, C, H', W') float32, padded with zeros at the bottom and right to multiples of 32.
    """
    x = images.permute(0, 3, 1, 2) if images.ndim == 4 else images[:, None]
    x = x.float() - mean
    if std is not None:
        x = x / std
    padding = [-side % STRIDE_5 for side in images.shape[1:3]]
    if any(padding):
        x = functional.pad(x, (0, padding[1], 0, padding[0]))
    return x.contiguous(memory_format=torch.channels_last)


def reduced(images: Tensor, factor: int) -> Tensor:
    """The means of the blocks of `factor` x `factor` pixels of (B, C, H, W) images."""
    return images if factor == 1 else functional.avg_pool2d(images, factor)
