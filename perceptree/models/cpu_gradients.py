"""Numba kernels for two gradients that torch computes slowly on CPUs.

The weight gradient of a depthwise convolution is 3 to 7 times faster than torch's, the gradient
of weighted sums of rows 4 times. Together they shorten a training step by a tenth
(benchmarks/training.py). Values differ from torch's by rounding only. They do not depend on the
number of threads.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from basetree.arrays import Float32


def depthwise_conv(x: Tensor, weight: Tensor, stride: int, padding: int) -> Tensor:
    """Depthwise convolution on the CPU.

    Args:
        x: (N, C, H, W) float32.
        weight: (C, 1, K, K) float32.
        stride: Stride in both directions.
        padding: Zeros added on each side.

    Returns:
        (N, C, H', W') float32.
    """
    out: Tensor = _Depthwise.apply(x, weight, stride, padding)
    return out


class _Depthwise(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, x: Tensor, weight: Tensor, stride: int, padding: int) -> Tensor:
        ctx.save_for_backward(x, weight)
        ctx.stride, ctx.padding = stride, padding
        return functional.conv2d(x, weight, None, stride, padding, groups=len(weight))

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, None, None]:
        from perceptree.models.cpu_kernels import depthwise_weight_gradient

        x, weight = ctx.saved_tensors
        of_input = None
        if ctx.needs_input_grad[0]:
            of_input = torch.ops.aten.convolution_backward(
                gradient,
                x,
                weight,
                None,
                [ctx.stride] * 2,
                [ctx.padding] * 2,
                [1, 1],
                False,
                [0, 0],
                len(weight),
                [True, False, False],
            )[0]
        side, channels = weight.shape[2], len(weight)
        of_weight = torch.empty(side, side, channels)
        _run_parts(
            depthwise_weight_gradient,
            channels,
            _channels_last(x),
            _channels_last(gradient),
            ctx.stride,
            ctx.padding,
            of_weight.numpy(),
        )
        return of_input, of_weight.permute(2, 0, 1)[:, None], None, None


def _channels_last(x: Tensor) -> Float32:
    """(N, C, H, W) as (N, H, W, C), contiguous."""
    return np.asarray(x.detach().permute(0, 2, 3, 1).contiguous().numpy())


def _run_parts(kernel: Callable[..., None], channels: int, *arguments: Any) -> None:
    """Run a kernel over all channels, split evenly over as many threads as torch uses."""
    parts = min(torch.get_num_threads(), channels)
    if parts == 1:
        kernel(*arguments, 0, channels)
        return
    ends = [part * channels // parts for part in range(parts + 1)]
    list(_threads(parts).map(lambda start, stop: kernel(*arguments, start, stop), ends, ends[1:]))


@lru_cache(maxsize=1)
def _threads(count: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(count)


def weighted_sums(rows: Tensor, indices: Tensor, starts: Tensor, weights: Tensor) -> Tensor:
    """Weighted sums of groups of rows, as `torch.nn.functional.embedding_bag` computes them.

    Group `b` consists of the entries from `starts[b]` to the next start. The gradient is
    computed for `rows` only.

    Args:
        rows: (P, C) float32.
        indices: (T,) int64, the row of each entry.
        starts: (B,) int64, the first entry of each group, ascending from 0.
        weights: (T,) float32, the weight of each entry.

    Returns:
        (B, C) float32, the sum of `rows[indices] * weights` over each group.
    """
    if torch.is_grad_enabled() and rows.requires_grad:
        sums: Tensor = _WeightedSums.apply(rows, indices, starts, weights)
        return sums
    return _sums(rows, indices, starts, weights)


def _sums(rows: Tensor, indices: Tensor, starts: Tensor, weights: Tensor) -> Tensor:
    return functional.embedding_bag(indices, rows, starts, mode="sum", per_sample_weights=weights)


class _WeightedSums(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, indices: Tensor, starts: Tensor, weights: Tensor) -> Tensor:
        ctx.save_for_backward(indices, starts, weights)
        ctx.count = len(rows)
        return _sums(rows, indices, starts, weights)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None, None]:
        from perceptree.models.cpu_kernels import weighted_sums_gradient

        indices, starts, weights = ctx.saved_tensors
        out = torch.zeros(ctx.count, gradient.shape[1])
        ends = torch.cat((starts, starts.new_tensor([len(indices)])))
        _run_parts(
            weighted_sums_gradient,
            out.shape[1],
            gradient.contiguous().numpy(),
            indices.numpy(),
            ends.numpy(),
            weights.numpy(),
            out.numpy(),
        )
        return out, None, None, None
