"""Decode keypoints from heat maps with subcell accuracy, batched over regions.

A heat map's logits are interpolated bicubically. The maximum of that surface is the keypoint.
"""

from __future__ import annotations

import functools

import torch
from torch import Tensor
from torch.nn import functional

from perceptree.models.spec import KeypointGrid

STEPS_PER_CELL = 8
BICUBIC_A = -0.75
# Search of the highest pixel: cells per round, pixels per cell and axis up to which the bound uses
# the pixels themselves, and differences that rounding explains, relative to the highest logit.
CELLS_PER_ROUND = 32
PIXELS_PER_CELL = 2
ROUNDING = 1e-6


def decode_keypoints(maps: Tensor, boxes: Tensor, grid: KeypointGrid, longest_px: int) -> Tensor:
    """Find each keypoint's position and score in its heat map.

    Args:
        maps: (R, K, S, S) logits, one heat map per region and keypoint.
        boxes: (R, 4) xyxy px, the area that a region's heat maps cover.
        grid: Possible positions, as `ModelSpec.keypoint_grid`.
        longest_px: Longest possible side of a box, px.

    Returns:
        (R, K, 3): x px, y px and score. The score is Detectron2's: the softmax over the S x S
        cells, evaluated at the peak.
    """
    regions, keypoints, size, _ = maps.shape
    flat = maps.reshape(regions * keypoints, size, size)
    sides = boxes[:, 2:] - boxes[:, :2]
    if grid == "subcell":
        share, peak = subcell_peaks(flat)
    else:
        share, peak = pixel_peaks(flat, sides, longest_px)
    # The interpolated peak can be far above all cells; keep the score finite.
    score = 1.0 / torch.exp(flat - peak[:, None, None]).sum(dim=(1, 2)).clamp(min=1e-6)
    share = share.reshape(regions, keypoints, 2)
    found = boxes[:, None, :2] + share * sides[:, None]
    return torch.cat((found, score.reshape(regions, keypoints, 1)), dim=2)


def keypoint_stds(maps: Tensor, keypoints: Tensor, boxes: Tensor) -> Tensor:
    """How sure each keypoint is: the standard deviation of its heat map.

    The softmax over a heat map's cells is trained as the probability of the place. Its mean square
    distance from the keypoint is large also where the map has a second peak.

    Args:
        maps: (R, K, S, S) logits, one heat map per region and keypoint.
        keypoints: (R, K, 3) as `decode_keypoints` finds them.
        boxes: (R, 4) xyxy px, the area that a region's heat maps cover.

    Returns:
        (R, K, 2): across and down the image, px.
    """
    size = maps.shape[-1]
    chances = maps.flatten(2).softmax(dim=2).reshape(maps.shape)
    corners, sides = boxes[:, None, :2], (boxes[:, 2:] - boxes[:, :2])[:, None]
    steps = (torch.arange(size, device=maps.device) + 0.5) / size
    places = corners[..., None] + steps * sides[..., None]
    off = places - keypoints[..., :2, None]
    along = torch.stack((chances.sum(dim=2), chances.sum(dim=3)), dim=2)
    return (along * off * off).sum(dim=3).sqrt()


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
    """Cut (M, side, side) patches at `top` and `left` (M,) out of maps (N, S, S).

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
    cells, the squares between four nodes, are searched in the order of an upper bound of the
    surface, until no other cell can have a higher pixel. An exported graph, whose amount of work
    is fixed, searches the first `CELLS_PER_ROUND` cells.

    Args:
        maps: (N, S, S) logits.
        sides: (R, 2) width and height of the boxes, px. N is a multiple of R; the maps of a box
            follow each other.
        longest_px: Longest possible side of a box, px.

    Returns:
        As `subcell_peaks`. Which one of several equal pixels is returned is undefined.
    """
    count, size, _ = maps.shape
    most = longest_px // size + 1
    pixels = sides.clamp(min=1.0).ceil()
    bounds = _cell_bounds(maps, pixels)
    pixels = pixels.repeat_interleave(count // len(sides), dim=0)
    bound, cells = torch.topk(bounds, CELLS_PER_ROUND, dim=1)
    found, peak = _highest_pixels(maps, pixels, cells, bound, most)
    if not torch.compiler.is_exporting():
        margin = ROUNDING * maps.abs().amax(dim=(1, 2))
        bounds = bounds.scatter(1, cells, -torch.inf)
        left = (bounds.amax(dim=1) > peak + margin).nonzero()[:, 0]
        while len(left):
            bound, cells = torch.topk(bounds[left], CELLS_PER_ROUND, dim=1)
            others, height = _highest_pixels(maps[left], pixels[left], cells, bound, most)
            higher = height > peak[left]
            found[left[higher]], peak[left[higher]] = others[higher], height[higher]
            bounds[left] = bounds[left].scatter(1, cells, -torch.inf)
            left = (bounds.amax(dim=1) > peak + margin).nonzero()[:, 0]
    return (found + 0.5) / pixels, peak


def _cell_bounds(maps: Tensor, pixels: Tensor) -> Tensor:
    """Upper bounds of the surface at the pixels of each cell; minus infinity without pixels.

    Between two nodes a row or column of the surface is a cubic, which does not exceed the highest
    of its four Bezier control values. An axis with few pixels uses their own values instead.

    Returns (N, (S + 1) * (S + 1)): the border is replicated, so there is one cell more than nodes.
    """
    count, size, _ = maps.shape
    matrix, empty = _bounding_matrices(pixels, size)
    bordered = functional.pad(maps[:, None], (2,) * 4, mode="replicate")
    bordered = bordered.reshape(len(pixels), -1, size + 4, size + 4)
    values = matrix[:, 1, None] @ bordered @ matrix[:, 0, None].transpose(2, 3)
    for _ in range(2):  # both axes
        values = functools.reduce(
            torch.maximum, (values[..., i : i + 3 * size + 1 : 3] for i in range(4))
        ).transpose(2, 3)
    empty = empty[:, 1, None, :, None] | empty[:, 0, None, None, :]
    return values.masked_fill(empty, -torch.inf).reshape(count, -1)


def _bounding_matrices(pixels: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Matrices from S + 4 nodes to bounding values, and which cells have no pixels, by axis.

    Each cell has three values, and shares the first one of the next cell.

    Returns (R, 2, 3 * (S + 1) + 1, S + 4) and (R, 2, S + 1).
    """
    start = torch.arange(-1, size + 1, device=pixels.device)
    limit = pixels[..., None]
    first, last = _pixel_range(start, limit, size)
    third = torch.arange(3, device=pixels.device)
    number = torch.minimum(first[..., None] + third, last[..., None])
    position = _node_position(number, limit[..., None], size)
    nodes = torch.arange(-2, size + 2, device=pixels.device)
    exact = cubic_weights(position[..., None] - nodes)
    # The tangent at a node is -a times the difference of its neighbours (Keys 1981).
    at = torch.eye(size + 6, device=pixels.device)
    at, tangent = at[:, 1:-1], BICUBIC_A / 3 * (at[:, 2:] - at[:, :-2])
    bezier = torch.stack((at[2:-2], at[2:-2] + tangent[2:-2], at[3:-1] - tangent[3:-1]), dim=1)
    few = limit <= PIXELS_PER_CELL * size
    matrix = torch.where(few[..., None, None], exact, bezier).flatten(2, 3)
    return matrix[:, :, :-2], (last < first)[..., :-1]


def _highest_pixels(
    maps: Tensor, pixels: Tensor, cells: Tensor, bound: Tensor, most: int
) -> tuple[Tensor, Tensor]:
    """Find the highest pixel in some cells (N, C) of each map.

    A cell has at most `most` pixels on each axis. Cells with a bound (N, C) of minus infinity
    have none. Returns pixel numbers (N, 2) in x and y, and the surface there (N,).
    """
    count, size, _ = maps.shape
    row, column = _split(cells, size + 1)
    start = torch.stack((column, row), dim=-1).flatten(0, 1) - 1
    limit = pixels.repeat_interleave(cells.shape[1], dim=0)
    first, last = (end[..., None] for end in _pixel_range(start, limit, size))
    number = torch.minimum(first + torch.arange(most, device=maps.device), last)
    position = _node_position(number, limit[..., None], size)
    taps = start[..., None] + torch.arange(-1, 3, device=maps.device)
    matrix = cubic_weights(position[..., None] - taps[:, :, None])
    patches = _patches(maps, start[:, 1] - 1, start[:, 0] - 1, 4)
    surface = matrix[:, 1] @ patches @ matrix[:, 0].transpose(1, 2)
    highest, within = surface.flatten(1).max(dim=1)
    highest = highest.reshape(bound.shape).masked_fill(bound == -torch.inf, -torch.inf)
    peak, cell = highest.max(dim=1)
    index = torch.arange(count, device=maps.device) * cells.shape[1] + cell
    down, across = _split(within[index], most)
    return torch.stack((number[index, 0, across], number[index, 1, down]), dim=1), peak


def _pixel_range(node: Tensor, pixels: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Numbers of the first and the last pixel with their centres from a node to the next one."""
    first, after = (((node + n + 0.5) * pixels / size - 0.5).ceil() for n in (0, 1))
    return first.clamp(min=0.0), torch.minimum(after, pixels) - 1.0


def _node_position(pixel: Tensor, pixels: Tensor, size: int) -> Tensor:
    """Position of a pixel's centre on the axis of `size` nodes that `pixels` pixels cover."""
    return (pixel + 0.5) * (size / pixels) - 0.5


def _split(index: Tensor, width: int) -> tuple[Tensor, Tensor]:
    row = torch.div(index, width, rounding_mode="floor")
    return row, index - row * width
