"""Numba kernels of the sensors. Results do not depend on the number of threads.

Kernels with ``prange`` give each row to one thread and share nothing between rows; random numbers
come in as arrays.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

_f = np.float32


@njit(parallel=True, cache=True, error_model="numpy")
def tone(samples, gains, fall_x, fall_y, toned):
    """Gain, vignette and a filmic curve on (2H, 2W, 3) samples, blended into ``toned`` (H, W, 3).

    Pixel (x, y) has its centre at sample (2x, 2y): a tent of 1, 2, 1 over the samples around it
    keeps the picture where depth and labels are. ``gains`` (3,) are those of red, green and blue;
    ``toned`` is blue, green, red. The share of light lost off the axis at a pixel is
    ``fall_x[x] + fall_y[y]``. The curve is Narkowicz's fit of the ACES film curve,
    x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14).
    """
    width = toned.shape[1]
    for y in prange(toned.shape[0]):
        line = np.zeros((2 * width, 3), np.float32)
        for k in range(3):
            row, weight = max(2 * y - 1 + k, 0), _f(0.5) if k == 1 else _f(0.25)
            for x in range(2 * width):
                fall = _f(1) - fall_x[x >> 1] - fall_y[y]
                for channel in range(3):
                    v = samples[row, x, channel] * (gains[channel] * fall)
                    v = v * (_f(2.51) * v + _f(0.03)) / (v * (_f(2.43) * v + _f(0.59)) + _f(0.14))
                    line[x, channel] += weight * min(v, _f(1))
        for x in range(width):
            for channel in range(3):
                toned[y, x, 2 - channel] = (
                    _f(0.25) * line[max(2 * x - 1, 0), channel]
                    + _f(0.5) * line[2 * x, channel]
                    + _f(0.25) * line[2 * x + 1, channel]
                )


@njit(parallel=True, cache=True, error_model="numpy")
def develop(toned, levels, deviations, normals, grain, colour_grain, image):
    """Gamma and noise: ``toned`` (H, W, 3) in 0..1 to ``image`` (H, W, 3) uint8.

    ``levels`` and ``deviations`` are the grey level and the noise's standard deviation in levels,
    both over the square root of the toned value. ``grain`` (H + 1, W + 1) and ``colour_grain``
    (H / 2 + 1, W / 2 + 1, 2) index ``normals`` (256,), the quantiles of a normal distribution.
    Neighbours share a part of the grain, as after demosaicing.
    """
    last = levels.shape[0] - 1
    for y in prange(toned.shape[0]):
        for x in range(toned.shape[1]):
            common = _f(0.72) * normals[grain[y, x]] + _f(0.36) * (
                normals[grain[y, x + 1]] + normals[grain[y + 1, x]]
            )
            blue = normals[colour_grain[y >> 1, x >> 1, 0]]
            red = normals[colour_grain[y >> 1, x >> 1, 1]]
            for channel in range(3):
                own = blue if channel == 0 else red if channel == 2 else _f(-0.5) * (blue + red)
                entry = int(np.sqrt(toned[y, x, channel]) * last + _f(0.5))
                noise = deviations[entry] * (common + _f(0.5) * own)
                image[y, x, channel] = int(min(max(levels[entry] + noise, _f(0)), _f(255)))


@njit(cache=True, error_model="numpy")
def draw_particles(image, depth_m, ends_px, z_m, radius_px, soft_px, opacity, colour):
    """Blend soft-edged strokes onto ``image`` (H, W, 3) uint8, each where nothing is nearer.

    A stroke runs between ``ends_px`` (N, 2, 2), corner-based px, at depth ``z_m`` (N,), with the
    half-width ``radius_px`` and an edge that fades over ``soft_px`` to either side of it. Its ends
    fade out. Depth 0 is sky.
    """
    height, width = depth_m.shape
    for n in range(z_m.shape[0]):
        x0, y0, x1, y1 = ends_px[n, 0, 0], ends_px[n, 0, 1], ends_px[n, 1, 0], ends_px[n, 1, 1]
        radius, soft, z = radius_px[n], soft_px[n], z_m[n]
        reach = radius + soft
        left = max(0, int(np.floor(min(x0, x1) - reach)))
        right = min(width - 1, int(np.floor(max(x0, x1) + reach)))
        top = max(0, int(np.floor(min(y0, y1) - reach)))
        bottom = min(height - 1, int(np.floor(max(y0, y1) + reach)))
        dx, dy = x1 - x0, y1 - y0
        squared = max(dx * dx + dy * dy, _f(1e-6))
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                behind = depth_m[y, x]
                if _f(0) < behind < z:
                    continue
                px, py = x + _f(0.5) - x0, y + _f(0.5) - y0
                along = min(max((px * dx + py * dy) / squared, _f(0)), _f(1))
                px, py = px - along * dx, py - along * dy
                cover = (reach - np.sqrt(px * px + py * py)) / (_f(2) * soft)
                if cover <= 0:
                    continue
                cover = min(cover, _f(1))
                share = opacity[n] * cover * cover * (_f(3) - _f(2) * cover)
                for channel in range(3):
                    before = _f(image[y, x, channel])
                    image[y, x, channel] = int(
                        before + (colour[channel] - before) * share + _f(0.5)
                    )


@njit(parallel=True, cache=True, error_model="numpy")
def mark_unseen(disparity, tolerance_px, unseen):
    """Set ``unseen`` (H, W) where the right camera of a stereo pair does not see a left pixel.

    The disparities are warped into the right image, the nearest winning; a left pixel is unseen
    where it falls outside that image or behind what is seen there. Disparity 0 is sky.
    """
    height, width = disparity.shape
    for y in prange(height):
        nearest = np.zeros(width + 1, np.float32)
        for x in range(width):
            d = disparity[y, x]
            column = int(np.floor(x - d))
            if column >= 0:
                nearest[column] = max(nearest[column], d)
                nearest[column + 1] = max(nearest[column + 1], d)
        for x in range(width):
            d = disparity[y, x]
            column = int(np.floor(x - d + _f(0.5)))
            unseen[y, x] = column < 0 or nearest[column] > d + tolerance_px


@njit(parallel=True, cache=True, error_model="numpy")
def invert_depth(depth_m, side, ratio, inverse):
    """``inverse`` (H / side, W / side) 1 / depth of blocks of ``side`` px, 0 on sky.

    A block has the mean of its pixels, or where their ratio exceeds ``ratio`` the nearest one.
    """
    for y in prange(inverse.shape[0]):
        for x in range(inverse.shape[1]):
            low, high, total = _f(np.inf), _f(0), _f(0)
            for j in range(y * side, (y + 1) * side):
                for i in range(x * side, (x + 1) * side):
                    value = _f(1) / depth_m[j, i] if depth_m[j, i] > 0 else _f(0)
                    low, high, total = min(low, value), max(high, value), total + value
            inverse[y, x] = high if high > low * ratio else total / _f(side * side)
