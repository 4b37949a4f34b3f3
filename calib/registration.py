"""Depth of one camera as another camera sees it."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.camera import PinholeCamera
from calib.pixels import image_to_opencv
from calib.points import check_size, image_rays, project_points
from calib.transform import RigidTransform

Float = NDArray[np.floating[Any]]

_STEEPEST = 0.1  # change of nearness from pixel to pixel, as a share, on one surface
_REACH_PX = 0.6  # from a depth pixel's centre: noise would open seams between halves
_LARGEST_FOOTPRINT_PX = 32
_LEAST_AREA_PX = 1e-3
_BLOCK = 4096


def register_depth(
    depth_m: NDArray[np.floating[Any]],
    depth_camera: PinholeCamera,
    colour_camera: PinholeCamera,
    depth_to_colour: RigidTransform,
) -> NDArray[np.float32]:
    """(H, W) metres of the depth camera to (H, W) metres along z of the colour camera.

    Each depth pixel is a small piece of plane, tilted as its neighbours say, and covers the colour
    pixels whose centres it projects onto; where several cover one, the nearest wins. Nothing is
    stretched across an edge of depth: what only the colour camera sees is 0, no reading. Raises
    CameraError where the map's size is not the depth camera's.
    """
    check_size(depth_camera, depth_m)
    nearness = np.zeros(colour_camera.height * colour_camera.width)
    pieces = _in_colour(depth_m, depth_camera, colour_camera, depth_to_colour)
    for start in range(0, len(pieces.nearness), _BLOCK):
        block = _Pieces(*(values[start : start + _BLOCK] for values in pieces))
        _splat(block, nearness, colour_camera)
    registered = np.divide(1.0, nearness, out=np.zeros_like(nearness), where=nearness > 0)
    shape = (colour_camera.height, colour_camera.width)
    return registered.reshape(shape).astype(np.float32)


class _Pieces(NamedTuple):
    """Depth pixels in the colour image: where they are, and what one depth pixel changes.

    ``centre_px``, ``along_u_px``, ``along_v_px`` (N, 2) colour px, per depth pixel to the right
    and down; ``nearness``, ``along_u``, ``along_v`` (N,) the same of 1 / z.
    """

    centre_px: Float
    along_u_px: Float
    along_v_px: Float
    nearness: Float
    along_u: Float
    along_v: Float


def _in_colour(
    depth_m: NDArray[np.floating[Any]],
    depth_camera: PinholeCamera,
    colour_camera: PinholeCamera,
    depth_to_colour: RigidTransform,
) -> _Pieces:
    """The pieces of plane that lie ahead of the colour camera and show it their front."""
    reading = np.isfinite(depth_m) & (depth_m > 0)
    nearness = np.divide(1.0, depth_m, out=np.zeros(depth_m.shape), where=reading)
    rays = image_rays(depth_camera)

    def moved(axis: int | None) -> tuple[Float, Float]:
        """px and nearness of the centres, or half a depth pixel further along an axis."""
        values = [*rays, nearness]
        if axis is not None:
            steps = [_gradient(rays[0], axis), _gradient(rays[1], axis), _tilt(nearness, axis)]
            values = [value + 0.5 * step for value, step in zip(values, steps, strict=True)]
        x, y, near = (np.broadcast_to(value, depth_m.shape)[reading] for value in values)
        points = depth_to_colour.apply(np.stack([x / near, y / near, 1 / near], -1))
        z = points[:, 2]
        nearness_there = np.divide(1.0, z, out=np.zeros_like(z), where=z > 0)
        return project_points(colour_camera, points), nearness_there

    (centre_px, near), (right_px, near_right), (below_px, near_below) = map(moved, (None, 1, 0))
    ahead = (near > 0) & (near_right > 0) & (near_below > 0)
    centre_px, near = centre_px[ahead], near[ahead]
    along_u_px = 2 * (right_px[ahead] - centre_px)
    along_v_px = 2 * (below_px[ahead] - centre_px)
    return _Pieces(
        centre_px,
        along_u_px,
        along_v_px,
        near,
        2 * (near_right[ahead] - near),
        2 * (near_below[ahead] - near),
    )


def _gradient(values: Float, axis: int) -> Float:
    """Change per pixel; 0 in an image of one pixel."""
    if values.shape[axis] == 1:
        return np.zeros_like(values)
    return np.asarray(np.gradient(values, axis=axis))


def _tilt(nearness: Float, axis: int) -> Float:
    """Change of nearness per pixel within a surface: the smaller of those to both neighbours.

    In the image of a plane the nearness changes evenly. 0 where no neighbour is near enough.
    """
    rows = nearness if axis == 0 else nearness.T
    step = np.diff(rows, axis=0)
    nearer = np.maximum(rows[1:], rows[:-1])
    step[(np.abs(step) > _STEEPEST * nearer) | (rows[1:] == 0) | (rows[:-1] == 0)] = np.inf
    edge = np.full((1, rows.shape[1]), np.inf)
    before, after = np.concatenate([edge, step]), np.concatenate([step, edge])
    tilt = np.where(np.abs(before) < np.abs(after), before, after)
    tilt[np.isinf(tilt)] = 0
    return tilt if axis == 0 else tilt.T


def _splat(pieces: _Pieces, nearness: Float, camera: PinholeCamera) -> None:
    """Raise ``nearness`` (H x W,) of the colour pixels to that of the pieces covering them."""
    (ux, uy), (vx, vy) = pieces.along_u_px.T, pieces.along_v_px.T
    area = ux * vy - uy * vx
    centre = image_to_opencv(pieces.centre_px)
    reach = _REACH_PX * (np.abs(pieces.along_u_px) + np.abs(pieces.along_v_px))
    size = (camera.width, camera.height)
    first = np.ceil(np.clip(centre - reach, 0, size)).astype(np.int64)
    last = np.floor(np.clip(centre + reach, -1, np.subtract(size, 1))).astype(np.int64)
    columns, rows = np.minimum(last - first + 1, _LARGEST_FOOTPRINT_PX).T
    seen = np.flatnonzero((area > _LEAST_AREA_PX) & (columns > 0) & (rows > 0))
    # What a colour pixel to the right or down changes of u, v (in depth px) and of the nearness.
    right = np.stack([vy, -uy, vy * pieces.along_u - uy * pieces.along_v])[:, seen] / area[seen]
    down = np.stack([-vx, ux, ux * pieces.along_v - vx * pieces.along_u])[:, seen] / area[seen]
    dx, dy = (first - centre)[seen].T
    start = right * dx + down * dy
    start[2] += pieces.nearness[seen]
    index = first[seen, 1] * camera.width + first[seen, 0]
    for row in range(rows[seen].max(initial=0)):
        use = np.flatnonzero(rows[seen] > row)
        state, step, width = start[:, use] + row * down[:, use], right[:, use], columns[seen][use]
        for column in range(width.max()):
            covered = (np.abs(state[0]) <= _REACH_PX) & (np.abs(state[1]) <= _REACH_PX)
            covered &= width > column
            pixel = index[use[covered]] + (row * camera.width + column)
            np.maximum.at(nearness, pixel, state[2, covered])
            state += step
