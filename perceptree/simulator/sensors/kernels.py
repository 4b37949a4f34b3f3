"""Numba kernels of the sensors.

Results do not depend on the number of threads: parallel kernels process rows independently, and
random numbers are passed as arrays.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

_f32 = np.float32


@njit(parallel=True, cache=True, error_model="numpy")
def tone(samples, gains, fall_x, fall_y, toned):
    """Apply gain, vignetting and a filmic tone curve to samples, and average them to pixels.

    The centre of pixel (x, y) is sample (2x, 2y). Samples are averaged with the weights 1, 2, 1
    in both directions, so that the picture is aligned with depth and labels. The tone curve is
    Narkowicz's fit (2016) of the ACES film curve,
    x (2.51 x + 0.03) / (x (2.43 x + 0.59) + 0.14).

    Args:
        samples: (2H, 2W, 3) float32 linear RGB.
        gains: (3,) gains of red, green and blue.
        fall_x: (W,) horizontal part of the fraction of light that vignetting removes.
        fall_y: (H,) vertical part of it.
        toned: (H, W, 3) float32, receives BGR, 0 to 1.
    """
    width = toned.shape[1]
    for y in prange(toned.shape[0]):
        line = np.zeros((2 * width, 3), np.float32)
        for k in range(3):
            row, weight = max(2 * y - 1 + k, 0), _f32(0.5) if k == 1 else _f32(0.25)
            for x in range(2 * width):
                fall = _f32(1) - fall_x[x >> 1] - fall_y[y]
                for channel in range(3):
                    v = samples[row, x, channel] * (gains[channel] * fall)
                    v = (
                        v
                        * (_f32(2.51) * v + _f32(0.03))
                        / (v * (_f32(2.43) * v + _f32(0.59)) + _f32(0.14))
                    )
                    line[x, channel] += weight * min(v, _f32(1))
        for x in range(width):
            for channel in range(3):
                toned[y, x, 2 - channel] = (
                    _f32(0.25) * line[max(2 * x - 1, 0), channel]
                    + _f32(0.5) * line[2 * x, channel]
                    + _f32(0.25) * line[2 * x + 1, channel]
                )


@njit(parallel=True, cache=True, error_model="numpy")
def develop(toned, levels, deviations, normals, grain, colour_grain, image):
    """Apply gamma and noise. The noise of neighbours is correlated, as after demosaicing.

    Args:
        toned: (H, W, 3) float32 BGR, 0 to 1.
        levels: (n,) grey level, tabulated over the square root of the toned value.
        deviations: (n,) standard deviation of the noise in grey levels, tabulated likewise.
        normals: (256,) quantiles of the normal distribution.
        grain: (H + 1, W + 1) uint8, random indices of `normals`.
        colour_grain: (H / 2 + 1, W / 2 + 1, 2) uint8, random indices for the colour noise.
        image: (H, W, 3) uint8, receives BGR.
    """
    last = levels.shape[0] - 1
    for y in prange(toned.shape[0]):
        for x in range(toned.shape[1]):
            common = _f32(0.72) * normals[grain[y, x]] + _f32(0.36) * (
                normals[grain[y, x + 1]] + normals[grain[y + 1, x]]
            )
            blue = normals[colour_grain[y >> 1, x >> 1, 0]]
            red = normals[colour_grain[y >> 1, x >> 1, 1]]
            for channel in range(3):
                own = blue if channel == 0 else red if channel == 2 else _f32(-0.5) * (blue + red)
                entry = int(np.sqrt(toned[y, x, channel]) * last + _f32(0.5))
                noise = deviations[entry] * (common + _f32(0.5) * own)
                image[y, x, channel] = int(min(max(levels[entry] + noise, _f32(0)), _f32(255)))


@njit(cache=True, error_model="numpy")
def draw_particles(image, depth_m, ends_px, z_m, radius_px, soft_px, opacity, colour):
    """Draw soft-edged strokes where they are in front of the scene.

    Args:
        image: (H, W, 3) uint8 BGR, changed in place.
        depth_m: (H, W) depth of the scene, m; 0 on sky.
        ends_px: (N, 2, 2) ends of the strokes, corner-based px.
        z_m: (N,) depths of the strokes, m.
        radius_px: (N,) half-widths, px.
        soft_px: (N,) width over which the opacity fades on both sides of the edge, px.
        opacity: (N,) opacities, 0 to 1.
        colour: (3,) BGR.
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
        squared = max(dx * dx + dy * dy, _f32(1e-6))
        for y in range(top, bottom + 1):
            for x in range(left, right + 1):
                behind = depth_m[y, x]
                if _f32(0) < behind < z:
                    continue
                px, py = x + _f32(0.5) - x0, y + _f32(0.5) - y0
                along = min(max((px * dx + py * dy) / squared, _f32(0)), _f32(1))
                px, py = px - along * dx, py - along * dy
                cover = (reach - np.sqrt(px * px + py * py)) / (_f32(2) * soft)
                if cover <= 0:
                    continue
                cover = min(cover, _f32(1))
                share = opacity[n] * cover * cover * (_f32(3) - _f32(2) * cover)
                for channel in range(3):
                    before = _f32(image[y, x, channel])
                    image[y, x, channel] = int(
                        before + (colour[channel] - before) * share + _f32(0.5)
                    )


@njit(parallel=True, cache=True, error_model="numpy")
def mark_unseen(disparity, tolerance_px, unseen):
    """Mark the pixels of a stereo pair's left image that the right camera cannot see.

    Disparities are warped into the right image, keeping the nearest. A left pixel is unseen if it
    falls outside that image or behind a nearer surface.

    Args:
        disparity: (H, W) float32, px; 0 on sky.
        tolerance_px: Disparity difference that still counts as the same surface.
        unseen: (H, W) bool, receives the result.
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
            column = int(np.floor(x - d + _f32(0.5)))
            unseen[y, x] = column < 0 or nearest[column] > d + tolerance_px


@njit(parallel=True, cache=True, error_model="numpy")
def invert_depth(depth_m, side, ratio, inverse):
    """Compute 1 / depth of blocks of pixels: their mean, or across an edge the nearest pixel.

    Args:
        depth_m: (H, W) float32, m; 0 on sky.
        side: Width and height of a block, px.
        ratio: Depth ratio within a block above which it contains an edge.
        inverse: (H / side, W / side) float32, receives 1 / depth, 1/m; 0 on sky.
    """
    for y in prange(inverse.shape[0]):
        for x in range(inverse.shape[1]):
            low, high, total = _f32(np.inf), _f32(0), _f32(0)
            for j in range(y * side, (y + 1) * side):
                for i in range(x * side, (x + 1) * side):
                    value = _f32(1) / depth_m[j, i] if depth_m[j, i] > 0 else _f32(0)
                    low, high, total = min(low, value), max(high, value), total + value
            inverse[y, x] = high if high > low * ratio else total / _f32(side * side)
