"""Depth images of upright cylinders on level ground, by exact ray casting."""

from __future__ import annotations

import numpy as np

from calib import PinholeCamera, RigidTransform, pixels_to_rays
from edgetree.frames.frame import Frame, stream_frame

CAMERA = PinholeCamera(width=160, height=90, fx=87.5, fy=87.5, cx=79.5, cy=44.5)
_HEIGHT_M, _FARTHEST_M = 2.0, 20.0


def cylinder_frame(
    places_m: np.ndarray,
    radii_m: np.ndarray,
    mounting: RigidTransform,
    time_s: float,
    *,
    vertical: bool = True,
    noise_m: float = 0.0,
) -> Frame:
    """What a camera sees of cylinders 6 m high on the ground; sky and far ground have no reading.

    Args:
        places_m: (N, 2) their places.
        radii_m: (N,) their radii.
        mounting: transform from the camera to the ground's frame.
        time_s: time stamp.
        vertical: whether the frame knows its vertical.
        noise_m: standard deviation of the depth.
    """
    rows, columns = np.mgrid[: CAMERA.height, : CAMERA.width]
    rays = mounting.rotate(pixels_to_rays(CAMERA, np.stack([columns, rows], -1) + 0.5))
    start = mounting.translation_m
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.where(rays[..., 2] < 0, -start[2] / rays[..., 2], np.inf)
        for place, radius_m in zip(places_m, radii_m, strict=True):
            off = start[:2] - place
            a = (rays[..., :2] ** 2).sum(-1)
            b = (rays[..., :2] * off).sum(-1)
            root = b**2 - a * (off @ off - radius_m**2)
            near = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
            height_m = start[2] + near * rays[..., 2]
            hit = (near > 0) & (height_m > 0) & (height_m < 6) & (near < depth_m)
            depth_m = np.where(hit, near, depth_m)
    depth_m[~(depth_m < _FARTHEST_M)] = 0.0
    noise = np.random.default_rng(round(1000 * time_s)).normal(0, noise_m, depth_m.shape)
    depth_m = np.where(depth_m > 0, depth_m + noise, 0.0)
    return stream_frame(
        number=round(10 * time_s),
        time_s=time_s,
        image=None,
        depth_m=depth_m.astype(np.float32),
        camera=CAMERA,
        up_camera=mounting.inverse().rotate([0.0, 0.0, 1.0]) if vertical else None,
    )


def mounted(x_m: float, y_m: float, heading_deg: float = 0.0, roll_deg: float = 0.0):
    """A camera 2 m above a place that looks a little down."""
    return RigidTransform.mounting(
        [x_m, y_m, _HEIGHT_M], roll_deg=roll_deg, pitch_deg=8.0, yaw_deg=heading_deg
    )
