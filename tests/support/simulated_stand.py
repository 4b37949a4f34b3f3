"""A simulated stand with exact geometry: what a camera on the move measures of its stems."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calib import PinholeCamera, RigidTransform, project_points
from edgetree import TreeDetections
from edgetree.frames.frame import Frame, stream_frame
from edgetree.measure import Estimate, Failure, PointEstimate, StemAxis, TreeMeasurement

CAMERA = PinholeCamera(width=640, height=360, fx=350.0, fy=350.0, cx=319.5, cy=179.5)
CAMERA_HEIGHT_M, CUT_M, REACH_M = 2.5, 0.2, 11.0
DIAMETER_STD_M, RANGE_STD_M, ASIDE_STD_M, CUT_STD_M, LEAN_STD_RAD = 0.02, 0.06, 0.02, 0.05, 0.03

Observation = tuple[Frame, TreeDetections, list[TreeMeasurement]]


@dataclass
class Forest:
    """Stems on a plane, and the errors of their measurements.

    The error of a view has the parts of `ErrorShares`: the same for a stem, the same for views
    from the same 10 degrees, and independent.
    """

    places_m: np.ndarray
    diameters_m: np.ndarray
    rng: np.random.Generator
    shares: tuple[float, float, float] = (0.0, 0.0, 1.0)
    hidden: frozenset[int] = frozenset()

    def __post_init__(self) -> None:
        self._shared: dict[tuple[int, ...], np.ndarray] = {}

    def _error(self, stem: int, view: int) -> np.ndarray:
        """(4,) errors in standard deviations: diameter, range, aside, cut."""
        parts = [
            self._shared.setdefault(key, self.rng.normal(size=4)) for key in ((stem,), (stem, view))
        ]
        parts.append(self.rng.normal(size=4))
        return sum(math.sqrt(share) * part for share, part in zip(self.shares, parts, strict=True))

    def observe(
        self,
        time_s: float,
        place_m: tuple[float, float],
        heading_deg: float,
        *,
        pose: bool = True,
        vertical: bool = True,
    ) -> Observation:
        """What a level camera sees at a place, with `stems_seen` in the order of the trees."""
        mounting = RigidTransform.mounting(
            [*place_m, CAMERA_HEIGHT_M], pitch_deg=8.0, yaw_deg=heading_deg
        )
        to_camera, measurements, boxes, self.stems_seen = mounting.inverse(), [], [], []
        up = to_camera.rotate([0.0, 0.0, 1.0])
        for stem, (place, diameter_m) in enumerate(
            zip(self.places_m, self.diameters_m, strict=True)
        ):
            base = to_camera.apply([*place, CUT_M])
            box = self._box(to_camera, place, diameter_m)
            if stem in self.hidden or box is None or np.linalg.norm(base) > REACH_M:
                continue
            sight = place - np.array(place_m)
            distance_m = float(np.hypot(*sight))
            sight = np.array([*(sight / distance_m), 0.0])
            aside = np.array([-sight[1], sight[0], 0.0])
            view = int(np.degrees(np.arctan2(sight[1], sight[0])) // 10)
            error = self._error(stem, view)
            off = error[1] * RANGE_STD_M * sight + error[2] * ASIDE_STD_M * aside
            point = np.array([*place, CUT_M]) + off + [0.0, 0.0, error[3] * CUT_STD_M]
            turn = to_camera.rotation
            stds = np.array([RANGE_STD_M, ASIDE_STD_M, CUT_STD_M])
            ways = turn @ np.stack([sight, aside, [0.0, 0.0, 1.0]], 1)
            in_camera = to_camera.apply(point)
            measurements.append(
                replace(
                    TreeMeasurement.failed("not simulated"),
                    diameter_m=Estimate(diameter_m + error[0] * DIAMETER_STD_M, DIAMETER_STD_M),
                    cut_height_m=Estimate(CUT_M + error[3] * CUT_STD_M, CUT_STD_M),
                    cut_point_m=PointEstimate(in_camera, stds),
                    axis=StemAxis(
                        point_m=in_camera,
                        point_covariance_m2=(ways * stds**2) @ ways.T,
                        direction=up,
                        direction_covariance=LEAN_STD_RAD**2 * np.eye(3),
                    ),
                )
            )
            boxes.append(box)
            self.stems_seen.append(stem)
        frame = stream_frame(
            number=round(time_s * 10),
            time_s=time_s,
            image=None,
            camera=CAMERA,
            up_camera=up if vertical else None,
            pose=mounting if pose else None,
        )
        return frame, detections(boxes), measurements

    def _box(self, to_camera: RigidTransform, place: np.ndarray, diameter_m: float):
        """Box of the lowest 2 m in the image; None if the foot is not in it."""
        foot, top = (to_camera.apply([*place, height_m]) for height_m in (0.0, 2.0))
        if foot[2] < 0.5 or top[2] < 0.5:
            return None
        (x, low), (_, high) = project_points(CAMERA, np.stack([foot, top]))
        half_px = CAMERA.fx * diameter_m / 2 / foot[2]
        inside = 0 < x < CAMERA.width and low > 0 and high < CAMERA.height
        return (x - half_px, max(high, 0.0), x + half_px, low) if inside else None


def detections(boxes: list) -> TreeDetections:
    """Detections with these boxes, without masks and keypoints."""
    return TreeDetections(
        np.array(boxes, np.float32).reshape(-1, 4),
        np.ones(len(boxes), np.float32),
        None,
        None,
        CAMERA.width,
        CAMERA.height,
    )


def stand(rng: np.random.Generator, **settings: object) -> Forest:
    """Some 40 stems around a square of 24 m, at least 1.5 m apart."""
    places: list[np.ndarray] = []
    while len(places) < 40:
        place = rng.uniform(-12, 12, 2)
        if all(np.linalg.norm(place - other) > 1.5 for other in places):
            places.append(place)
    return Forest(np.array(places), rng.uniform(0.1, 0.6, 40), rng, **settings)


def unmeasured(reason: str) -> TreeMeasurement:
    """A tree of which nothing is measured."""
    return TreeMeasurement.failed(reason)


def without_diameter(measurement: TreeMeasurement, reason: str) -> TreeMeasurement:
    """The same measurement without its diameter."""
    return replace(measurement, diameter_m=Failure(reason))
