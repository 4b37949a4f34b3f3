"""Pooling of regions from one or several pyramid levels: aligned RoIAlign (He et al. 2017).

Two forms of the same sum. The library's operator exports, and suits GPUs. On a CPU a region's
cell is a weighted sum of a few of the maps' columns, added up with all channels at once: about
three times as fast as the operator, over ten times with its gradient.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor
from torchvision.ops import roi_align

from perceptree.models.cpu_gradients import weighted_sums

CANONICAL_SIZE_PX = 224.0
CANONICAL_LEVEL = 4


def assign_levels(boxes: Tensor, levels: tuple[int, ...]) -> Tensor:
    """Level of each (R, 4) xyxy px box -> (R,) int64, equation 1 of the FPN paper."""
    size = boxes[:, 2:] - boxes[:, :2]
    side = size.clamp(min=0.0).prod(dim=1).sqrt()
    level = torch.floor(CANONICAL_LEVEL + torch.log2(side / CANONICAL_SIZE_PX + 1e-8))
    return level.clamp(levels[0], levels[-1]).long()


class RegionPooler:
    """Pools regions from a batch's pyramid maps, level -> (B, C, h, w).

    ``samples`` per cell and axis; 0 takes one for each cell of the map that the region's cell
    covers. Regions lie within the image.
    """

    def __init__(self, maps: dict[int, Tensor], levels: tuple[int, ...], samples: int) -> None:
        self._levels, self._samples = levels, samples
        chosen = [maps[level].float() for level in levels]
        operator = torch.compiler.is_exporting() or chosen[0].device.type != "cpu"
        self._pool = (_OperatorPool if operator else _GatherPool)(chosen)

    def __call__(self, boxes: Tensor, images: Tensor, cells: int) -> Tensor:
        """Regions (R, 4) xyxy px of images (R,) int64 -> (R, C, cells, cells)."""
        row = assign_levels(boxes, self._levels) - self._levels[0]
        scale = boxes.new_tensor([2.0**-level for level in self._levels])[row]
        return self._pool(boxes * scale[:, None], images, row, cells, self._samples)


class _OperatorPool:
    """The operator on one map that holds all levels side by side, each with repeated borders.

    Every region is pooled once, and no data is moved by where regions happen to lie.
    """

    def __init__(self, maps: list[Tensor]) -> None:
        self._corners = [(0, 0)]
        self._map = maps[0].contiguous()
        if len(maps) > 1:
            self._map, self._corners = _side_by_side(maps)

    def __call__(
        self, boxes: Tensor, images: Tensor, row: Tensor, cells: int, samples: int
    ) -> Tensor:
        if len(self._corners) > 1:
            boxes = boxes + boxes.new_tensor([corner * 2 for corner in self._corners])[row]
        regions = torch.cat((images.to(boxes.dtype)[:, None], boxes), dim=1)
        pooled: Tensor = roi_align(self._map, regions, cells, 1.0, samples, aligned=True)
        return pooled


def _side_by_side(maps: list[Tensor]) -> tuple[Tensor, list[tuple[int, int]]]:
    """The first map, beside it the others in a column -> one map, and (x, y) of each corner.

    Where one map follows another, both borders are repeated; at the joined map's own borders the
    operator does that itself.
    """
    first, others = maps[0], [_stretched(x, 2, 1, 1) for x in maps[1:]]
    wide = max(x.shape[3] for x in others) + 2
    rows = [x.shape[2] for x in others]
    tops = [sum(rows[:i]) for i in range(len(rows))]
    column = torch.cat([_stretched(x, 3, 1, wide - 1 - x.shape[3]) for x in others], dim=2)
    missing = sum(rows) - first.shape[2]
    first = _stretched(first, 2, 0, max(missing, 0))
    column = _stretched(column, 2, 0, max(-missing, 0))
    left = first.shape[3] + 1
    joined = torch.cat((*_with_borders(first, 3, 0, 1), column), dim=3)
    return joined, [(0, 0)] + [(left + 1, top + 1) for top in tops]


def _stretched(x: Tensor, axis: int, before: int, after: int) -> Tensor:
    """The map with its first and last row or column repeated so often."""
    return torch.cat(_with_borders(x, axis, before, after), dim=axis) if before or after else x


def _with_borders(x: Tensor, axis: int, before: int, after: int) -> list[Tensor]:
    ends = ((0, before), (x.shape[axis] - 1, after))
    low, high = (
        [x.index_select(axis, torch.tensor([place] * times, device=x.device))] if times else []
        for place, times in ends
    )
    return [*low, x, *high]


class _GatherPool:
    """Weighted sums of the columns (all channels at one place) of all levels' maps."""

    def __init__(self, maps: list[Tensor]) -> None:
        columns = [x.permute(0, 2, 3, 1).reshape(-1, x.shape[1]) for x in maps]
        self._columns = torch.cat(columns) if len(columns) > 1 else columns[0]
        starts = torch.tensor([0] + [len(x) for x in columns[:-1]]).cumsum(0)
        self._starts = starts
        self._sizes = torch.tensor([x.shape[2:] for x in maps])

    def __call__(
        self, boxes: Tensor, images: Tensor, row: Tensor, cells: int, samples: int
    ) -> Tensor:
        size = self._sizes[row]
        across = _axis_taps(boxes[:, 0], boxes[:, 2], size[:, 1], cells, samples)
        down = _axis_taps(boxes[:, 1], boxes[:, 3], size[:, 0], cells, samples)
        # One bag for each cell of each region, its taps row by row.
        bag = torch.arange(len(boxes) * cells * cells)
        counts = (across.span * down.span).repeat_interleave(cells * cells)
        ends = counts.cumsum(0)
        owner = bag.repeat_interleave(counts)
        within = torch.arange(len(owner)) - (ends - counts)[owner]
        region = torch.div(owner, cells * cells, rounding_mode="floor")
        wide = across.span[region]
        tap_y = torch.div(within, wide, rounding_mode="floor")
        tap_x = within - tap_y * wide
        cell_y = torch.div(owner, cells, rounding_mode="floor")
        cell_x = region * cells + owner - cell_y * cells
        weight = down.weight[cell_y, tap_y] * across.weight[cell_x, tap_x]
        y = torch.minimum(down.first[cell_y] + tap_y, size[region, 0] - 1)
        x = torch.minimum(across.first[cell_x] + tap_x, size[region, 1] - 1)
        start = self._starts[row] + images * size.prod(dim=1)
        place = start[region] + y * size[region, 1] + x
        pooled = weighted_sums(self._columns, place, ends - counts, weight)
        channels = self._columns.shape[1]
        return pooled.reshape(len(boxes), cells, cells, channels).permute(0, 3, 1, 2)


class _Taps(NamedTuple):
    """Which cells of a map, along one axis, make up each cell of R regions."""

    first: Tensor
    """(R * cells,) int64, the first tap's place."""
    weight: Tensor
    """(R * cells, T) float32, of the first tap and those after it."""
    span: Tensor
    """(R,) int64, taps that matter for any cell of a region."""


def _axis_taps(low: Tensor, high: Tensor, length: Tensor, cells: int, samples: int) -> _Taps:
    """Taps of regions from ``low`` to ``high`` (R,) on maps of ``length`` (R,) cells.

    A cell is the mean of evenly spread samples, each of which interpolates its two neighbours.
    Samples over a cell outside the map count nothing, the others stick to its border, and a
    region without size has none where each cell of the map takes one, as in the library's
    operator.
    """
    size = high - low
    taken = torch.ceil(size / cells).clamp(min=1.0) if samples == 0 else size * 0 + samples
    number = torch.arange(int(taken.max()) if len(taken) else 1)
    used = (number < taken[:, None])[:, None]
    share = (torch.arange(cells)[:, None] + ((number + 0.5) / taken[:, None])[:, None]) / cells
    position = low[:, None, None] + share * size[:, None, None] - 0.5
    end = length[:, None, None]
    counted = used & (position >= -1.0) & (position <= end)
    if samples == 0:
        counted &= (size > 0.0)[:, None, None]
    position = torch.minimum(position.clamp(min=0.0), end - 1.0)
    first = position[..., 0].floor()
    last = torch.where(used, position, 0.0).amax(dim=2).floor() + 1.0
    span = (last - first).amax(dim=1).long() + 1
    tap = torch.arange(int(span.max()) if len(span) else 1)
    distance = (position - first[..., None])[..., None] - tap
    weight = ((1.0 - distance.abs()).clamp(min=0.0) * counted[..., None]).sum(dim=2)
    weight = weight / taken[:, None, None]
    return _Taps(first.long().flatten(), weight.flatten(0, 1), span)
