"""Twenty stems before a camera that moves, all measured in every frame, to measure the speed."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from calib import PinholeCamera, RigidTransform
from edgetree import TreeDetections
from edgetree.frames.frame import Frame, stream_frame
from edgetree.measure import Estimate, PointEstimate, StemAxis, TreeMeasurement

_CAMERA = PinholeCamera(width=640, height=360, fx=350.0, fy=350.0, cx=319.5, cy=179.5)
_FRAMES, _RATE_HZ, _HEIGHT_M, _CUT_M = 150, 10.0, 2.5, 0.2
# Standard deviations along the line of sight, to the side, and up.
_STD_M = np.array([0.06, 0.02, 0.05])


def twenty_stems(
    pose: bool, vertical: bool
) -> list[tuple[Frame, TreeDetections, list[TreeMeasurement]]]:
    """Frames with 20 measured stems each, with the pose and the vertical or without them."""
    rng = np.random.default_rng(0)
    ahead, aside = np.meshgrid(4 + 1.6 * np.arange(5), 1.6 * (np.arange(4) - 1.5))
    places = np.stack([ahead.ravel(), aside.ravel()], -1) + rng.normal(0, 0.2, (20, 2))
    diameters_m = rng.uniform(0.1, 0.6, 20)
    frames = []
    for number in range(_FRAMES):
        time_s = number / _RATE_HZ
        camera = RigidTransform.mounting(
            [0.1 * time_s - 1.5, 0.3 * math.sin(time_s), _HEIGHT_M],
            pitch_deg=8.0,
            yaw_deg=5 * math.sin(0.7 * time_s),
        )
        measurements = [
            _measured(camera, place, diameter_m, rng)
            for place, diameter_m in zip(places, diameters_m, strict=True)
        ]
        trees = TreeDetections(
            np.tile(np.array([300, 0, 320, 200], np.float32), (20, 1)),
            np.ones(20, np.float32),
            None,
            None,
            _CAMERA.width,
            _CAMERA.height,
        )
        up_camera = np.asarray(camera.inverse().rotate([0.0, 0.0, 1.0]), np.float64)
        live = stream_frame(
            number=number,
            time_s=time_s,
            image=None,
            camera=_CAMERA,
            up_camera=up_camera if vertical else None,
            pose=camera if pose else None,
        )
        frames.append((live, trees, measurements))
    return frames


def _measured(
    camera: RigidTransform, place: np.ndarray, diameter_m: float, rng: np.random.Generator
) -> TreeMeasurement:
    sight = place - camera.translation_m[:2]
    sight = sight / np.linalg.norm(sight)
    ways = np.array([[*sight, 0.0], [-sight[1], sight[0], 0.0], [0.0, 0.0, 1.0]])
    to_camera = camera.inverse()
    point = to_camera.apply([*place, _CUT_M] + (rng.normal(size=3) * _STD_M) @ ways)
    turned = to_camera.rotate(ways) * _STD_M[:, None]
    std_m = 0.07 * diameter_m
    return replace(
        TreeMeasurement.failed("not measured here"),
        diameter_m=Estimate(diameter_m + rng.normal() * std_m, std_m),
        cut_height_m=Estimate(_CUT_M, float(_STD_M[2])),
        cut_point_m=PointEstimate(point, _STD_M),
        axis=StemAxis(
            point_m=point,
            point_covariance_m2=turned.T @ turned,
            direction=to_camera.rotate([0.0, 0.0, 1.0]),
            direction_covariance=0.03**2 * np.eye(3),
        ),
    )
