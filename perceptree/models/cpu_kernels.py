"""Numba kernels of gradients, for the channels from `start` to `stop`.

Calls for different channels may run in parallel: each writes only its own channels, and sums in
the order of the rows. All arrays are stored with the channels last.
"""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(inline="always", cache=True)
def _add_product(total, a, b):
    for c in range(len(total)):
        total[c] += a[c] * b[c]


@njit(nogil=True, cache=True, error_model="numpy")
def depthwise_weight_gradient(x, gradient, stride, padding, out, start, stop):
    """Gradient of a depthwise convolution's weights.

    Args:
        x: (N, H, W, C) float32 input of the convolution.
        gradient: (N, h, w, C) float32, gradient of its output.
        stride: Stride in both directions.
        padding: Zeros added on each side.
        out: (K, K, C) float32, receives the gradient of the weights.
        start: First channel to compute.
        stop: End of the channels to compute.
    """
    images, height, width, _ = x.shape
    side = out.shape[0]
    total = np.zeros((side, side, stop - start), np.float32)
    for n in range(images):
        for row in range(gradient.shape[1]):
            for i in range(side):
                y = row * stride + i - padding
                if y < 0 or y >= height:
                    continue
                for column in range(gradient.shape[2]):
                    output_gradient = gradient[n, row, column, start:stop]
                    for j in range(side):
                        left = column * stride + j - padding
                        if 0 <= left < width:
                            _add_product(total[i, j], output_gradient, x[n, y, left, start:stop])
    out[:, :, start:stop] = total


@njit(nogil=True, cache=True, error_model="numpy")
def weighted_sums_gradient(gradient, indices, starts, weights, out, start, stop):
    """Gradient of weighted sums of rows with respect to the rows.

    Sum `b` adds the rows `indices[starts[b]:starts[b + 1]]` times their `weights`.

    Args:
        gradient: (B, C) float32, gradient of the sums.
        indices: (T,) int64, the row of each entry.
        starts: (B + 1,) int64, the first entry of each sum, and T.
        weights: (T,) float32.
        out: (P, C) float32 zeros, receives the gradient of the rows.
        start: First channel to compute.
        stop: End of the channels to compute.
    """
    for bag in range(gradient.shape[0]):
        sum_gradient = gradient[bag, start:stop]
        for tap in range(starts[bag], starts[bag + 1]):
            row, weight = out[indices[tap], start:stop], weights[tap]
            for c in range(len(row)):
                row[c] += weight * sum_gradient[c]
