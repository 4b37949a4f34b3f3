"""Training with rounded weights, so that an INT8 file finds what the checkpoint finds.

Forward and backward pass use rounded weights; the gradient changes the exact ones, from which they
are rounded anew in the next step (Jacob et al. 2018, "Quantization and training of neural networks
for efficient integer-arithmetic-only inference").
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, nn

_LARGEST = 127  # of a signed byte


@contextmanager
def rounded_weights(model: nn.Module, bits: int | None) -> Iterator[None]:
    """Round the weights of convolutions and linear layers inside the block; restore them after it.

    `edgetree export --precision int8` rounds in the same way, so that rounded weights of
    convolutions stay as they are.

    Args:
        model: The model.
        bits: Bits of a weight with its sign; None rounds nothing.
    """
    if bits is None:
        yield
        return
    weights = [m.weight.data for m in model.modules() if isinstance(m, nn.Conv2d | nn.Linear)]
    exact = [weight.clone() for weight in weights]
    try:
        for weight in weights:
            weight.copy_(_rounded(weight, min(2 ** (bits - 1), _LARGEST)))
        yield
    finally:
        for weight, value in zip(weights, exact, strict=True):
            weight.copy_(value)


def _rounded(weight: Tensor, levels: int) -> Tensor:
    """Round to multiples of the largest weight of each output divided by `levels`."""
    largest = weight.abs().amax(tuple(range(1, weight.ndim)), keepdim=True)
    scale = (largest / levels).clamp(min=torch.finfo(weight.dtype).tiny)
    return (weight / scale).round() * scale
