"""Reading keypoints from heat maps to a fraction of a cell, without a loop over regions.

The logits of a heat map are the nodes of a bicubic surface, whose peak is the keypoint.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from perceptree.models.spec import KeypointGrid

STEPS_PER_CELL = 8
BICUBIC_A = -0.75
# Peaks on pixels: coarse samples per cell, and how many of the best are looked around.
COARSE_PER_CELL = 2
CANDIDATES = 8


def decode_keypoints(maps: Tensor, boxes: Tensor, grid: KeypointGrid, longest_px: int) -> Tensor:
    """Heat maps (R, K, S, S) over boxes (R, 4) xyxy px -> (R, K, 3): x px, y px, score.

    The score is Detectron2's: the softmax over the S x S cells, evaluated at the peak.
    ``longest_px`` is the longest side that a box can have.
    """
    regions, keypoints, size, _ = maps.shape
    flat = maps.reshape(regions * keypoints, size, size)
    sides = (boxes[:, 2:] - boxes[:, :2]).repeat_interleave(keypoints, dim=0)
    if grid == "subcell":
        share, peak = subcell_peaks(flat)
    else:
        share, peak = pixel_peaks(flat, sides, longest_px)
    # A surface may rise far above its cells; the score stays finite then.
    score = 1.0 / torch.exp(flat - peak[:, None, None]).sum(dim=(1, 2)).clamp(min=1e-6)
    start = boxes[:, :2].repeat_interleave(keypoints, dim=0)
    found = torch.cat((start + share * sides, score[:, None]), dim=1)
    return found.reshape(regions, keypoints, 3)


def cubic_weights(distance: Tensor) -> Tensor:
    """Keys' kernel with a = -0.75, as torch's and OpenCV's bicubic resizing have it."""
    x = distance.abs()
    near = ((BICUBIC_A + 2) * x - (BICUBIC_A + 3)) * x * x + 1
    far = BICUBIC_A * (((x - 5) * x + 8) * x - 4)
    return torch.where(x <= 1, near, torch.where(x < 2, far, 0.0))


def subcell_peaks(maps: Tensor) -> tuple[Tensor, Tensor]:
    """The peak of each surface (N, S, S) within a cell of the strongest node.

    Searched on a grid of an eighth of a cell and then on a parabola. Returns (N, 2), x and y as
    a share of the map's side, and the surface's height (N,).
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
    """(M, side, side) nodes of maps (N, S, S) from ``top`` and ``left`` (M,), borders repeated.

    M is a multiple of N: so many patches of the first map, then of the next one.
    """
    count, size, _ = maps.shape
    reach = torch.arange(side, device=maps.device)
    rows = (top[:, None] + reach).clamp(0, size - 1)
    columns = (left[:, None] + reach).clamp(0, size - 1)
    index = (rows[:, :, None] * size + columns[:, None, :]).reshape(count, -1)
    return torch.gather(maps.flatten(1), 1, index).reshape(-1, side, side)


def _parabola(flat: Tensor, best: Tensor, position: Tensor, stride: int) -> Tensor:
    """Where a parabola through a fine peak and its two neighbours is highest, in fine steps."""
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
    """The highest pixel of each surface (N, S, S) resized to a box of ``sides`` (N, 2) px.

    This is Detectron2's reading: the surface at the centres of the box's pixels, their number
    rounded up. First some pixels of each cell are read (of small boxes, every pixel), then all
    within a cell of the best of these. Returns as :func:`subcell_peaks`.
    """
    count, size, _ = maps.shape
    pixels = sides.clamp(min=1.0).ceil()
    spread, coarse = _spread_pixels(maps, pixels)
    rows, columns = _split(torch.topk(coarse, CANDIDATES, dim=1).indices, spread.shape[2])
    chosen = torch.gather(spread, 2, torch.stack((columns, rows), dim=1))
    chosen = chosen.transpose(1, 2).flatten(0, 1)[..., None]
    reach = longest_px // size + 1
    number = chosen + torch.arange(-reach, reach + 1, device=maps.device)
    limit = pixels.repeat_interleave(CANDIDATES, dim=0)[..., None]
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
    place = torch.arange(count, device=maps.device) * CANDIDATES + candidate
    found = torch.stack((number[place, 0, across], number[place, 1, down]), dim=1)
    return (found + 0.5) / pixels, peak


def _spread_pixels(maps: Tensor, pixels: Tensor) -> tuple[Tensor, Tensor]:
    """Pixels (N, 2, P) spread over a box, x and y, and the surface there (N, P * P).

    P is two for each node; with fewer pixels than that they are all taken, and what is left
    over is minus infinity.
    """
    size = maps.shape[-1]
    count = COARSE_PER_CELL * size
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
    """Where the centre of a pixel lies among ``size`` nodes, when ``pixels`` span them."""
    return (pixel + 0.5) * (size / pixels) - 0.5


def _split(index: Tensor, width: int) -> tuple[Tensor, Tensor]:
    row = torch.div(index, width, rounding_mode="floor")
    return row, index - row * width
