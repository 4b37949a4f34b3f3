"""Reading keypoints from heat maps to a fraction of a cell, without a loop over regions."""

from __future__ import annotations

import torch
from torch import Tensor

STEPS_PER_CELL = 8
BICUBIC_A = -0.75
REACH = 2


def refine_matrix() -> Tensor:
    """Bicubic weights (17, 5) of positions -1 to +1 cells about the middle of five samples.

    Keys' kernel with a = -0.75, as torch's and OpenCV's bicubic resizing have it.
    """
    offsets = torch.arange(-STEPS_PER_CELL, STEPS_PER_CELL + 1) / STEPS_PER_CELL
    samples = torch.arange(-REACH, REACH + 1)
    distance = (offsets[:, None] - samples[None, :]).abs()
    near = (BICUBIC_A + 2) * distance**3 - (BICUBIC_A + 3) * distance**2 + 1
    far = BICUBIC_A * (distance**3 - 5 * distance**2 + 8 * distance - 4)
    return torch.where(distance <= 1, near, torch.where(distance < 2, far, 0.0))


def decode_keypoints(maps: Tensor, boxes: Tensor, matrix: Tensor) -> Tensor:
    """Heat maps (R, K, S, S) over boxes (R, 4) xyxy px -> (R, K, 3): x px, y px, score.

    The peak is that of the bicubic surface through the logits, searched within a cell of the
    strongest one on a grid of an eighth of a cell and then on a parabola. The score is
    Detectron2's: the softmax over the S x S cells, evaluated at the peak.
    ``matrix`` is :func:`refine_matrix`.
    """
    regions, keypoints, size, _ = maps.shape
    flat = maps.reshape(regions * keypoints, size * size)
    best = flat.argmax(dim=1)
    row = torch.div(best, size, rounding_mode="floor")
    column = best - row * size
    surface = matrix @ _patches(flat, row, column, size) @ matrix.T
    dy, dx, peak = _surface_peak(surface)
    # A surface may rise far above its cells; the score stays finite then.
    score = 1.0 / torch.exp(flat - peak[:, None]).sum(dim=1).clamp(min=1e-6)
    x = ((column + dx + 0.5) / size).reshape(regions, keypoints)
    y = ((row + dy + 0.5) / size).reshape(regions, keypoints)
    left, top, right, bottom = boxes[:, :, None].unbind(dim=1)
    x_px = left + x * (right - left)
    y_px = top + y * (bottom - top)
    return torch.stack((x_px, y_px, score.reshape(regions, keypoints)), dim=-1)


def _patches(flat: Tensor, row: Tensor, column: Tensor, size: int) -> Tensor:
    """The 5x5 logits about each peak, (N, 5, 5), borders repeated."""
    reach = torch.arange(-REACH, REACH + 1, device=flat.device)
    rows = (row[:, None] + reach).clamp(0, size - 1)
    columns = (column[:, None] + reach).clamp(0, size - 1)
    index = (rows[:, :, None] * size + columns[:, None, :]).reshape(flat.shape[0], -1)
    return torch.gather(flat, 1, index).reshape(-1, 2 * REACH + 1, 2 * REACH + 1)


def _surface_peak(surface: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Offsets in cells and height of the maximum of (N, 17, 17) fine samples."""
    count, steps, _ = surface.shape
    flat = surface.reshape(count, steps * steps)
    peak, best = flat.max(dim=1)
    row = torch.div(best, steps, rounding_mode="floor")
    column = best - row * steps
    dy = row + _parabola(flat, best, row, steps)
    dx = column + _parabola(flat, best, column, 1)
    return dy / STEPS_PER_CELL - 1.0, dx / STEPS_PER_CELL - 1.0, peak


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
