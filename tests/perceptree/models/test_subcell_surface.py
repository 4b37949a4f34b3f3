"""Subcell keypoints against a densely sampled bicubic surface of the same heat map."""

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from perceptree.models.decode import subcell_peaks

S = 56
FINE = 16  # samples of the dense surface per cell
COUNT = 60


def bumps(kind: str) -> Tensor:
    """(N, S, S) logits like the head's: at half the resolution, upsampled bilinearly."""
    random = torch.Generator().manual_seed(sum(map(ord, kind)))

    def uniform(low: float, high: float) -> Tensor:
        return low + (high - low) * torch.rand(COUNT, 1, 1, generator=random)

    def bump(low: float, high: float, height: Tensor) -> Tensor:
        grid = torch.arange(S // 2) + 0.5
        x, y = uniform(low, high), uniform(low, high)
        wide, tall = uniform(0.8, 5.0), uniform(0.8, 5.0)
        square = ((grid[None, None] - x) / wide) ** 2 + ((grid[None, :, None] - y) / tall) ** 2
        return height * torch.exp(-0.5 * square)

    coarse = bump(2.0, S / 2 - 2.0, uniform(6.0, 14.0))
    if kind == "border":
        coarse = bump(-1.0, 2.0, uniform(6.0, 14.0))
        coarse[::2] = coarse[::2].flip(1, 2)
    if kind == "two":
        coarse = coarse + bump(2.0, S / 2 - 2.0, uniform(4.0, 8.0))
    if kind in ("noise", "two"):
        coarse = coarse + 0.3 * torch.randn(coarse.shape, generator=random)
    return functional.interpolate(coarse[:, None], scale_factor=2.0, mode="bilinear")[:, 0]


def dense_peaks(maps: Tensor) -> Tensor:
    """(N, 2) x and y of the highest of ``FINE`` x ``FINE`` samples per cell, over the side."""
    fine = functional.interpolate(maps[:, None], scale_factor=FINE, mode="bicubic")[:, 0]
    peak = fine.flatten(1).argmax(dim=1)
    row = torch.div(peak, S * FINE, rounding_mode="floor")
    return torch.stack((peak - row * S * FINE + 0.5, row + 0.5), dim=1) / (S * FINE)


@pytest.mark.parametrize("kind", ["clear", "noise", "two", "border"])
def test_the_peak_is_that_of_the_dense_surface(kind: str) -> None:
    maps = bumps(kind)
    random = torch.Generator().manual_seed(2)
    sides = 20.0 * 35 ** torch.rand(COUNT, 2, generator=random)  # 20 to 700 px
    assert float(sides.min()) < 25
    assert float(sides.max()) > 600
    share, _ = subcell_peaks(maps)
    gap_px = (share - dense_peaks(maps)).abs() * sides
    allowed_px = (0.1 * sides / S).clamp(min=0.5)
    near = (gap_px <= allowed_px).all(dim=1)
    assert float(near.float().mean()) >= 0.95
