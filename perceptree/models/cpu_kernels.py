"""Numba kernels of gradients, for the channels from ``start`` to ``stop``.

Calls for different channels may run in threads at the same time: each writes to channels of its
own, and sums in the order of the rows. Memory of all arrays is laid out with the channels last.
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
    """``out`` (K, K, C): of a depthwise convolution of ``x`` (N, H, W, C), float32.

    ``gradient`` (N, h, w, C) is that of its result.
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
                    risen = gradient[n, row, column, start:stop]
                    for j in range(side):
                        left = column * stride + j - padding
                        if 0 <= left < width:
                            _add_product(total[i, j], risen, x[n, y, left, start:stop])
    out[:, :, start:stop] = total


@njit(nogil=True, cache=True, error_model="numpy")
def weighted_sums_gradient(gradient, places, starts, weights, out, start, stop):
    """``out`` (P, C), zero before: what each of P rows gets of weighted sums of rows, float32.

    Sum ``b``, of gradient (B, C), takes the rows ``places[starts[b]:starts[b + 1]]`` times
    ``weights``.
    """
    for bag in range(gradient.shape[0]):
        risen = gradient[bag, start:stop]
        for tap in range(starts[bag], starts[bag + 1]):
            row, weight = out[places[tap], start:stop], weights[tap]
            for c in range(len(row)):
                row[c] += weight * risen[c]
