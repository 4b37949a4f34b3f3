"""Decode keypoints from heat maps with subcell accuracy, batched over regions.

A heat map's logits are interpolated bicubically. The maximum of that surface is the keypoint.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from perceptree.models.spec import KeypointGrid

STEPS_PER_CELL = 8
BICUBIC_A = -0.75
# Search of the best pixel: samples per cell in the first pass, and how many of the best samples
# the second pass refines.
COARSE_SAMPLES_PER_CELL = 2
PEAK_CANDIDATES = 8


def decode_keypoints(maps: Tensor, boxes: Tensor, grid: KeypointGrid, longest_px: int) -> Tensor:
    """Find each keypoint's position and score in its heat map.

    Args:
        maps: (R, K, S, S) logits, one heat map per region and keypoint.
        boxes: (R, 4) xyxy px, the area that a region's heat maps cover.
        grid: Possible positions, as ``ModelSpec.keypoint_grid``.
        longest_px: Longest possible side of a box, px.

    Returns:
        (R, K, 3): x px, y px and score. The score is Detectron2's: the softmax over the S x S
        cells, evaluated at the peak.
    """
    regions, keypoints, size, _ = maps.shape
    flat = maps.reshape(regions * keypoints, size, size)
    sides = (boxes[:, 2:] - boxes[:, :2]).repeat_interleave(keypoints, dim=0)
    if grid == "subcell":
        share, peak = subcell_peaks(flat)
    else:
        share, peak = pixel_peaks(flat, sides, longest_px)
    # The interpolated peak can be far above all cells; keep the score finite.
    score = 1.0 / torch.exp(flat - peak[:, None, None]).sum(dim=(1, 2)).clamp(min=1e-6)
    start = boxes[:, :2].repeat_interleave(keypoints, dim=0)
    found = torch.cat((start + share * sides, score[:, None]), dim=1)
    return found.reshape(regions, keypoints, 3)


def cubic_weights(distance: Tensor) -> Tensor:
    """Bicubic weights at a distance in cells (Keys 1981, a = -0.75 as in torch and OpenCV)."""
    x = distance.abs()
    near = ((BICUBIC_A + 2) * x - (BICUBIC_A + 3)) * x * x + 1
    far = BICUBIC_A * (((x - 5) * x + 8) * x - 4)
    return torch.where(x <= 1, near, torch.where(x < 2, far, 0.0))


def subcell_peaks(maps: Tensor) -> tuple[Tensor, Tensor]:
    """Find the peak of each surface within one cell of the highest node.

    The peak is searched on a grid of 1/8 cell and refined with a parabola.

    Args:
        maps: (N, S, S) logits.

    Returns:
        (N, 2) x and y as fractions of the map's side, and (N,) the surface's value there.
    """
    count, size, _ = maps.shape
    row, column = _split(maps.flatten(1).argmax(dim=1), size)
    steps = 2 * STEPS_PER_CELL + 1
    offsets = torch.arange(steps, device=maps.device) / STEPS_PER_CELL - 1.0
    matrix = cubic_weights(offsets[:, None] - torch.arange(-2, 3, device=maps.device))
    patches = _patches(maps, row - 2, column - 2, 5)
    surface = (matrix @ patches @ matrix.T).reshape(count, -1)
    peak, best = surface.max(dim=1)
    down, across = _split(best, steps)
    dx = (across + _parabola(surface, best, across, 1)) / STEPS_PER_CELL - 1.0
    dy = (down + _parabola(surface, best, down, steps)) / STEPS_PER_CELL - 1.0
    return torch.stack((column + dx + 0.5, row + dy + 0.5), dim=1) / size, peak


def _patches(maps: Tensor, top: Tensor, left: Tensor, side: int) -> Tensor:
    """Cut (M, side, side) patches at ``top`` and ``left`` (M,) out of maps (N, S, S).

    Borders are replicated. M is a multiple of N; the patches of a map follow each other.
    """
    count, size, _ = maps.shape
    reach = torch.arange(side, device=maps.device)
    rows = (top[:, None] + reach).clamp(0, size - 1)
    columns = (left[:, None] + reach).clamp(0, size - 1)
    index = (rows[:, :, None] * size + columns[:, None, :]).reshape(count, -1)
    return torch.gather(maps.flatten(1), 1, index).reshape(-1, side, side)


def _parabola(flat: Tensor, best: Tensor, position: Tensor, stride: int) -> Tensor:
    """Offset of the maximum of a parabola through a sample and its two neighbours, in samples."""
    last = flat.shape[1] - 1
    middle, before, after = (
        torch.gather(flat, 1, (best + shift).clamp(0, last)[:, None])[:, 0]
        for shift in (0, -stride, stride)
    )
    bend = (2.0 * middle - before - after).clamp(min=1e-9)
    offset = (0.5 * (after - before) / bend).clamp(-0.5, 0.5)
    inside = (position > 0) & (position < 2 * STEPS_PER_CELL)
    return torch.where(inside, offset, 0.0)


def pixel_peaks(maps: Tensor, sides: Tensor, longest_px: int) -> tuple[Tensor, Tensor]:
    """Find the highest pixel of each heat map resized to the size of its box, as Detectron2 does.

    The surface is evaluated at the centres of the box's pixels, whose number is rounded up. The
    first pass evaluates two pixels per cell and axis (every pixel of small boxes), the second one
    all pixels within one cell of the best of these.

    Args:
        maps: (N, S, S) logits.
        sides: (N, 2) width and height of the boxes, px.
        longest_px: Longest possible side of a box, px.

    Returns:
        As :func:`subcell_peaks`.
    """
    count, size, _ = maps.shape
    pixels = sides.clamp(min=1.0).ceil()
    spread, coarse = _coarse_surface(maps, pixels)
    rows, columns = _split(torch.topk(coarse, PEAK_CANDIDATES, dim=1).indices, spread.shape[2])
    chosen = torch.gather(spread, 2, torch.stack((columns, rows), dim=1))
    chosen = chosen.transpose(1, 2).flatten(0, 1)[..., None]
    reach = longest_px // size + 1
    number = chosen + torch.arange(-reach, reach + 1, device=maps.device)
    limit = pixels.repeat_interleave(PEAK_CANDIDATES, dim=0)[..., None]
    middle = _node_position(chosen, limit, size)
    position = _node_position(number, limit, size)
    start = middle.floor() - 2.0
    taps = start + torch.arange(6, device=maps.device)
    matrix = cubic_weights(position[..., None] - taps[:, :, None])
    first = start[..., 0].long()
    patches = _patches(maps, first[:, 1], first[:, 0], 6)
    surface = matrix[:, 1] @ patches @ matrix[:, 0].transpose(1, 2)
    seen = (number >= 0.0) & (number < limit) & ((position - middle).abs() <= 1.0)
    surface = surface.masked_fill(~(seen[:, 1, :, None] & seen[:, 0, None, :]), -torch.inf)
    peak, best = surface.reshape(count, -1).max(dim=1)
    steps = 2 * reach + 1
    candidate, within = _split(best, steps * steps)
    down, across = _split(within, steps)
    index = torch.arange(count, device=maps.device) * PEAK_CANDIDATES + candidate
    found = torch.stack((number[index, 0, across], number[index, 1, down]), dim=1)
    return (found + 0.5) / pixels, peak


def _coarse_surface(maps: Tensor, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Evaluate the surface on a coarse grid of pixels.

    Returns pixel numbers (N, 2, P) in x and y, and the surface there (N, P * P). P is two per
    node. A box with fewer pixels uses all of them, and the remaining values are minus infinity.
    """
    size = maps.shape[-1]
    count = COARSE_SAMPLES_PER_CELL * size
    number = torch.arange(count, device=maps.device)
    limit = pixels[..., None]
    number = torch.where(limit > count, ((number + 0.5) * limit / count - 0.5).round(), number)
    bordered = functional.pad(maps[:, None], (2,) * 4, mode="replicate")[:, 0]
    taps = torch.arange(-2, size + 2, device=maps.device)
    matrix = cubic_weights(_node_position(number, limit, size)[..., None] - taps)
    surface = matrix[:, 1] @ bordered @ matrix[:, 0].transpose(1, 2)
    seen = number < limit
    surface = surface.masked_fill(~(seen[:, 1, :, None] & seen[:, 0, None, :]), -torch.inf)
    return number, surface.flatten(1)


def _node_position(pixel: Tensor, pixels: Tensor, size: int) -> Tensor:
    """Position of a pixel's centre on the axis of ``size`` nodes that ``pixels`` pixels cover."""
    return (pixel + 0.5) * (size / pixels) - 0.5


def _split(index: Tensor, width: int) -> tuple[Tensor, Tensor]:
    row = torch.div(index, width, rounding_mode="floor")
    return row, index - row * width
