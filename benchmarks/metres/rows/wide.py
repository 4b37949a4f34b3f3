"""Stems through fisheyes and strong wide angles, beside pinhole cameras that look at them."""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.sensors import stereo_noise
from benchmarks.metres.stand import Stem
from calib import PinholeCamera, project_points

ASIDE_DEG = (0.0, 30.0, 60.0)
"""Angles of the stems from the optical axis."""


def fisheye(rng: np.random.Generator, view_deg: float, width: int = 1280) -> PinholeCamera:
    """An equidistant fisheye of a horizontal field of view, with small further terms."""
    height = width * 5 // 8
    focal = width / np.radians(view_deg)
    centre = np.array([width, height]) / 2 + rng.uniform(-6, 6, 2)
    terms = rng.normal(0, 1, 4) * (0.015, 0.003, 0.0005, 0.0001)
    return PinholeCamera(
        width, height, focal, focal, *centre.tolist(), tuple(terms.tolist()), "fisheye"
    )


def barrel(rng: np.random.Generator, width: int = 1280) -> PinholeCamera:
    """A wide angle of about 110 degrees with strong barrel distortion, as of action cameras."""
    height = width * 5 // 8
    focal = width * rng.uniform(0.45, 0.5)
    centre = np.array([width, height]) / 2 + rng.uniform(-6, 6, 2)
    k1, k4 = rng.uniform(0.05, 0.07), rng.uniform(0.2, 0.3)
    terms = (k1, 0.0, 0.0, 0.0, 0.0, k4, 0.0, 0.0)
    return PinholeCamera(width, height, focal, focal, *centre.tolist(), terms)


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
) -> Readings:
    """A stem through a lens, or through a pinhole that looks at it with as many pixels per radian.

    Args:
        rng: Source of the scene.
        aside_deg: Angle of the stem from straight ahead.
        view_deg: Field of view of a fisheye; None for a strong barrel distortion.
        vertical: Whether the vertical is given.
        alone: Whether a mask is given without keypoints.
        pinhole: Whether a pinhole takes the place of the lens.
    """
    camera = barrel(rng) if view_deg is None else fisheye(rng, view_deg)
    one = stem_aside(rng, aside_deg)
    if pinhole:
        turn = np.arctan2(one.right_m, one.ahead_m) + np.array([-1e-3, 1e-3])
        rays = np.stack([np.sin(turn), np.zeros(2), np.cos(turn)], -1)
        left, right = project_points(camera, rays)
        focal = float(right[0] - left[0]) / 2e-3
        camera = PinholeCamera(camera.width, camera.height, focal, focal, camera.cx, camera.cy)
        away = float(np.hypot(one.right_m, one.ahead_m))
        one = Stem(**{**vars(one), "right_m": 0.0, "ahead_m": away})
    frame = stand(rng, [one], camera=camera)
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    if alone:
        trees = frame.detections(keypoints=False)
        return frame.readings(trees, given_masks=frame.masks(), vertical=vertical)
    return frame.readings(frame.detections(rng), vertical=vertical)


_LENSES = {"90": 90.0, "120": 120.0, "160": 160.0, "barrel": None}
_SEEN = {"90": 38.0, "120": 60.0, "160": 60.0, "barrel": 45.0}

ROWS = {
    f"{kind}-{name}-{min(aside, _SEEN[name]):.0f}": partial(
        through_lens,
        aside_deg=min(aside, _SEEN[name] - 6.0),
        view_deg=view,
        pinhole=kind == "looking-at",
    )
    for kind in ("wide", "looking-at")
    for name, view in _LENSES.items()
    for aside in ASIDE_DEG
}
