"""Stems through fisheyes and strong wide angles, beside pinhole cameras that look at them."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.sensors import stereo_noise
from benchmarks.metres.stand import Stand, Stem
from calib import PinholeCamera, project_points
from edgetree import TreeDetections
from edgetree.measure import MeasureSettings


def fisheye(rng: np.random.Generator, view_deg: float, width: int = 1280) -> PinholeCamera:
    """An equidistant fisheye of a horizontal field of view, with small further terms."""
    height = width * 5 // 8
    focal = float(width / np.radians(view_deg))
    cx, cy = (np.array([width, height]) / 2 + rng.uniform(-6, 6, 2)).tolist()
    terms = rng.normal(0, 1, 4) * (0.015, 0.003, 0.0005, 0.0001)
    return PinholeCamera(width, height, focal, focal, cx, cy, tuple(terms.tolist()), "fisheye")


def barrel(rng: np.random.Generator, width: int = 1280) -> PinholeCamera:
    """A wide angle of about 110 degrees with strong barrel distortion, as of action cameras."""
    height = width * 5 // 8
    focal = width * rng.uniform(0.45, 0.5)
    cx, cy = (np.array([width, height]) / 2 + rng.uniform(-6, 6, 2)).tolist()
    k1, k4 = rng.uniform(0.05, 0.07), rng.uniform(0.2, 0.3)
    terms = (k1, 0.0, 0.0, 0.0, 0.0, k4, 0.0, 0.0)
    return PinholeCamera(width, height, focal, focal, cx, cy, terms)


def stem_aside(rng: np.random.Generator, aside_deg: float) -> Stem:
    """A stem near an angle from straight ahead."""
    turn, ahead = np.radians(aside_deg + rng.uniform(-4, 4)), rng.uniform(3.5, 8.0)
    turn *= rng.choice((-1, 1))
    return stem(rng, right_m=ahead * np.sin(turn), ahead_m=ahead * np.cos(turn))


def through_lens(
    rng: np.random.Generator,
    *,
    aside_deg: float,
    view_deg: float | None = None,
    vertical: bool = True,
    alone: bool = False,
    pinhole: bool = False,
    width: int = 1280,
) -> Readings:
    """A stem through a lens, or through a pinhole that looks at it with as many pixels per radian.

    Args:
        rng: Source of the scene.
        aside_deg: Angle of the stem from straight ahead.
        view_deg: Field of view of a fisheye; None for a strong barrel distortion.
        vertical: Whether the vertical is given.
        alone: Whether a mask is given without keypoints.
        pinhole: Whether a pinhole takes the place of the lens.
        width: Width of the picture in px.
    """
    camera = barrel(rng, width) if view_deg is None else fisheye(rng, view_deg, width)
    one = stem_aside(rng, aside_deg)
    if pinhole:
        turn = np.arctan2(one.right_m, one.ahead_m) + np.array([-1e-3, 1e-3])
        rays = np.stack([np.sin(turn), np.zeros(2), np.cos(turn)], -1)
        left, right = project_points(camera, rays)
        focal = float(right[0] - left[0]) / 2e-3
        camera = PinholeCamera(camera.width, camera.height, focal, focal, camera.cx, camera.cy)
        away = float(np.hypot(one.right_m, one.ahead_m))
        one = replace(one, right_m=0.0, ahead_m=away)
    frame = stand(rng, [one], camera=camera)
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    if alone:
        trees = frame.detections(keypoints=False)
        return frame.readings(trees, given_masks=frame.masks(), vertical=vertical)
    return frame.readings(with_errors(frame, rng), vertical=vertical)


def with_errors(frame: Stand, rng: np.random.Generator) -> TreeDetections:
    """Detections with errors of the keypoints across and along stems that the lens may tilt."""
    trees, settings = frame.detections(), MeasureSettings()
    assert trees.keypoints_px is not None
    points = trees.keypoints_px.copy()
    along = points[:, 4, :2] - points[:, 0, :2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    turn = np.stack([np.stack([-along[:, 1], along[:, 0]], -1), along], 1)
    width, height = (trees.boxes_px[:, 2:] - trees.boxes_px[:, :2]).T
    least = settings.keypoint_std_px * trees.image_width / 1280
    spread = (settings.keypoint_spread * width, settings.keypoint_slide * np.sqrt(width * height))
    std_px = np.hypot(least, np.stack(spread, -1))
    errors = rng.standard_normal((len(points), 5, 2)) * std_px[:, None]
    points[..., :2] += errors @ turn
    return replace(trees, keypoints_px=points)


# Fields of view of the lenses, and angles of the stems from straight ahead, in degrees.
_ROWS = {
    "90": (90.0, (0.0, 30.0, 38.0)),
    "120": (120.0, (0.0, 30.0, 54.0)),
    "160": (160.0, (0.0, 30.0, 60.0)),
    "barrel": (None, (0.0, 30.0, 45.0)),
}

ROWS = {
    f"{kind}-{name}-{aside_deg:.0f}": partial(
        through_lens, aside_deg=aside_deg, view_deg=view_deg, pinhole=kind == "looking-at"
    )
    for kind in ("wide", "looking-at")
    for name, (view_deg, asides_deg) in _ROWS.items()
    for aside_deg in asides_deg
}
