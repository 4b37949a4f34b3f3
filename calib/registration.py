"""Register a depth map to another camera."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from basetree.arrays import Float, Float32
from calib.camera import PinholeCamera
from calib.pixels import image_to_opencv
from calib.points import check_size, image_rays, project_points
from calib.transform import RigidTransform

_MAX_RELATIVE_STEP = 0.1  # of inverse depth between neighbouring pixels of one surface
_HALF_WIDTH_PX = 0.6  # of a patch in depth px; more than 0.5, or noise would open gaps
_MAX_FOOTPRINT_PX = 32
_MIN_AREA_PX = 1e-3
_BLOCK = 4096


def register_depth(
    depth_m: Float,
    depth_camera: PinholeCamera,
    colour_camera: PinholeCamera,
    depth_to_colour: RigidTransform,
) -> Float32:
    """Transform a depth map into the view of another camera.

    Each depth pixel becomes a small planar patch, tilted according to its neighbours. It covers the
    colour pixels whose centres it projects onto; where several patches cover a pixel, the nearest
    wins. Patches do not bridge depth edges: parts that only the colour camera sees are 0.

    Args:
        depth_m: (H, W) metres along z of the depth camera, 0 for no reading.
        depth_camera: Camera of the depth map.
        colour_camera: Camera of the result.
        depth_to_colour: Transform from depth to colour camera coordinates.

    Returns:
        (H, W) float32 metres along z of the colour camera, 0 for no reading.

    Raises:
        CameraError: If the map does not have the depth camera's size.
    """
    check_size(depth_camera, depth_m)
    inverse_depth = np.zeros(colour_camera.height * colour_camera.width)
    patches = _project_patches(depth_m, depth_camera, colour_camera, depth_to_colour)
    for start in range(0, len(patches.inverse_depth), _BLOCK):
        block = _Patches(*(values[start : start + _BLOCK] for values in patches))
        _splat(block, inverse_depth, colour_camera)
    registered = np.divide(
        1.0, inverse_depth, out=np.zeros_like(inverse_depth), where=inverse_depth > 0
    )
    shape = (colour_camera.height, colour_camera.width)
    return registered.reshape(shape).astype(np.float32)


class _Patches(NamedTuple):
    """Depth pixels projected into the colour image, with their derivatives.

    u and v are the column and row of a depth pixel.

    Attributes:
        centre_px: (N, 2) centres in colour px.
        along_u_px: (N, 2) derivative of `centre_px` with respect to u.
        along_v_px: (N, 2) derivative of `centre_px` with respect to v.
        inverse_depth: (N,) 1 / z in the colour camera.
        along_u: (N,) derivative of `inverse_depth` with respect to u.
        along_v: (N,) derivative of `inverse_depth` with respect to v.
    """

    centre_px: Float
    along_u_px: Float
    along_v_px: Float
    inverse_depth: Float
    along_u: Float
    along_v: Float


def _project_patches(
    depth_m: Float,
    depth_camera: PinholeCamera,
    colour_camera: PinholeCamera,
    depth_to_colour: RigidTransform,
) -> _Patches:
    """Return the patches that lie in front of the colour camera."""
    reading = np.isfinite(depth_m) & (depth_m > 0)
    inverse_depth = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=reading)
    rays = image_rays(depth_camera)

    def moved(axis: int | None) -> tuple[Float, Float]:
        """Return px and 1 / z of the centres, or of points half a depth pixel along an axis."""
        values = [*rays, inverse_depth]
        if axis is not None:
            steps = [_gradient(rays[0], axis), _gradient(rays[1], axis), _tilt(inverse_depth, axis)]
            values = [value + 0.5 * step for value, step in zip(values, steps, strict=True)]
        x, y, near = (np.broadcast_to(value, depth_m.shape)[reading] for value in values)
        points = depth_to_colour.apply(np.stack([x / near, y / near, 1 / near], -1))
        z = points[:, 2]
        inverse_there = np.divide(1.0, z, out=np.zeros_like(z), where=z > 0)
        return project_points(colour_camera, points), inverse_there

    (centre_px, near), (right_px, near_right), (below_px, near_below) = map(moved, (None, 1, 0))
    ahead = (near > 0) & (near_right > 0) & (near_below > 0)
    centre_px, near = centre_px[ahead], near[ahead]
    along_u_px = 2 * (right_px[ahead] - centre_px)
    along_v_px = 2 * (below_px[ahead] - centre_px)
    return _Patches(
        centre_px,
        along_u_px,
        along_v_px,
        near,
        2 * (near_right[ahead] - near),
        2 * (near_below[ahead] - near),
    )


def _gradient(values: Float, axis: int) -> Float:
    """Return the change per pixel along an axis; 0 if the image has one pixel there."""
    if values.shape[axis] == 1:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values, axis=axis))


def _tilt(inverse_depth: Float, axis: int) -> Float:
    """Return the change of inverse depth per pixel within a surface.

    In the image of a plane, inverse depth changes linearly. The smaller of the changes to both
    neighbours is used; 0 if neither neighbour lies on the same surface.
    """
    rows = inverse_depth if axis == 0 else inverse_depth.T
    step = np.diff(rows, axis=0)
    larger = np.maximum(rows[1:], rows[:-1])
    step[(np.abs(step) > _MAX_RELATIVE_STEP * larger) | (rows[1:] == 0) | (rows[:-1] == 0)] = np.inf
    edge = np.full((1, rows.shape[1]), np.inf)
    before, after = np.concatenate([edge, step]), np.concatenate([step, edge])
    tilt = np.where(np.abs(before) < np.abs(after), before, after)
    tilt[np.isinf(tilt)] = 0
    return tilt if axis == 0 else tilt.T


def _splat(patches: _Patches, inverse_depth: Float, camera: PinholeCamera) -> None:
    """Update `inverse_depth` (H x W,) of the colour pixels with the patches that cover them.

    Each patch has a box of colour pixels around it. The boxes of all patches are gone through
    together, row by row and from left to right. At every step, the place of the pixel in depth px
    from the patch's centre, and its inverse depth there, change by the same amounts; a pixel within
    the patch keeps the largest inverse depth that it gets.
    """
    (ux, uy), (vx, vy) = patches.along_u_px.T, patches.along_v_px.T
    area = ux * vy - uy * vx
    centre = image_to_opencv(patches.centre_px)
    reach = _HALF_WIDTH_PX * (np.abs(patches.along_u_px) + np.abs(patches.along_v_px))
    size = (camera.width, camera.height)
    first = np.ceil(np.clip(centre - reach, 0, size)).astype(np.int64)
    last = np.floor(np.clip(centre + reach, -1, np.subtract(size, 1))).astype(np.int64)
    columns, rows = np.minimum(last - first + 1, _MAX_FOOTPRINT_PX).T
    seen = np.flatnonzero((area > _MIN_AREA_PX) & (columns > 0) & (rows > 0))
    # Changes of u, v (in depth px) and inverse depth per colour pixel to the right and down.
    right = np.stack([vy, -uy, vy * patches.along_u - uy * patches.along_v])[:, seen] / area[seen]
    down = np.stack([-vx, ux, ux * patches.along_v - vx * patches.along_u])[:, seen] / area[seen]
    dx, dy = (first - centre)[seen].T
    start = right * dx + down * dy
    start[2] += patches.inverse_depth[seen]
    index = first[seen, 1] * camera.width + first[seen, 0]
    for row in range(rows[seen].max(initial=0)):
        use = np.flatnonzero(rows[seen] > row)
        state, step, width = start[:, use] + row * down[:, use], right[:, use], columns[seen][use]
        for column in range(width.max()):
            covered = (np.abs(state[0]) <= _HALF_WIDTH_PX) & (np.abs(state[1]) <= _HALF_WIDTH_PX)
            covered &= width > column
            pixel = index[use[covered]] + (row * camera.width + column)
            np.maximum.at(inverse_depth, pixel, state[2, covered])
            state += step
