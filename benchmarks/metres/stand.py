"""Stems in a scene, their true values, and what a detector would give of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Float32, Index
from benchmarks.metres.caster import Cone, Ground, cast, smooth_noise
from calib import PinholeCamera, project_points
from edgetree import TreeDetections
from edgetree.measure import MeasureSettings, TreeMeasurement, measure_trees

BREAST_HEIGHT_M = 1.3
# Stems go on so far below the ground that its bumps leave no gap.
BELOW_M = 0.3


@dataclass(frozen=True)
class Stem:
    """A stem; positions are relative to the ground below the camera.

    Attributes:
        diameter_m: Diameter at the foot: the geometric mean of an oval section.
        right_m, ahead_m: Place of the foot.
        lean_deg: Lean from the vertical.
        lean_towards_deg: Its direction: 0 to the right of the image, 90 away from the camera.
        cut_m, section_m: Places of the cut and of the diameter's section along the axis.
        top_m: Length of the stem.
        taper: Decrease of the diameter per metre.
        oval: Ratio of the axes of the section.
        oval_turn_deg: Direction of the longer axis: 0 across the view, 90 along it.
        measured: Whether it is detected and measured; others are background or obstacles.
    """

    diameter_m: float = 0.3
    right_m: float = 0.0
    ahead_m: float = 5.0
    lean_deg: float = 0.0
    lean_towards_deg: float = 0.0
    cut_m: float = 0.2
    section_m: float = 0.2
    top_m: float = 6.0
    taper: float = 0.012
    oval: float = 1.0
    oval_turn_deg: float = 0.0
    measured: bool = True


@dataclass
class Stand:
    """A frame of stems on sloping ground, rendered when it is made.

    Attributes:
        stems: The stems.
        camera: Pinhole camera.
        camera_height_m, pitch_deg, roll_deg: Its pose; a positive pitch looks down.
        slope_deg, uphill_deg: Slope of the ground, and its direction as `Stem.lean_towards_deg`.
        bumps_std_m: Unevenness of the ground.
        plants_m, plant_cell_m: Plants on the ground, see `Ground`.
        things: Cones in front of the stems, in level axes (right, down, ahead) from the camera.
        seed: Seed of the bumps.
        depth_m: (H, W) depth, exact until a row changes it.
        owner: (H, W) number of the stem that a pixel shows, from 1; see `caster` for the others.
    """

    stems: list[Stem]
    camera: PinholeCamera
    camera_height_m: float = 1.8
    pitch_deg: float = 6.0
    roll_deg: float = 0.0
    slope_deg: float = 0.0
    uphill_deg: float = 90.0
    bumps_std_m: float = 0.015
    plants_m: Float | None = None
    plant_cell_m: float = 0.05
    things: list[Cone] = field(default_factory=list)
    seed: int = 0
    depth_m: Float32 = field(init=False)
    owner: Index = field(init=False)

    def __post_init__(self) -> None:
        pitch, roll = np.radians([self.pitch_deg, self.roll_deg])
        nod = np.array(
            [[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]]
        )
        turn = np.array(
            [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
        )
        self.to_camera = turn @ nod
        self.up = self.to_camera @ np.array([0.0, -1.0, 0.0])
        slope, uphill = np.radians([self.slope_deg, self.uphill_deg])
        self.gradient = np.tan(slope) * np.array([np.cos(uphill), np.sin(uphill)])
        rng = np.random.default_rng(self.seed)
        feet = np.array([[stem.right_m, stem.ahead_m] for stem in self.stems])
        self.ground = Ground(
            self.camera_height_m,
            self.gradient,
            smooth_noise(rng, 64, max(self.bumps_std_m, 1e-9)),
            plants_m=self.plants_m,
            plant_cell_m=self.plant_cell_m,
            around_m=feet,
        )
        self.cones = [self._cone(stem, number + 1) for number, stem in enumerate(self.stems)]
        self.render()

    def render(self) -> None:
        """Cast all rays anew, after a change of `things`."""
        things = [
            replace(
                thing,
                start_m=self.to_camera @ thing.start_m,
                along=self.to_camera @ thing.along,
            )
            for thing in self.things
        ]
        self.depth_m, self.owner = cast(
            self.camera, self.to_camera, self.ground, self.cones + things
        )

    def _cone(self, stem: Stem, number: int) -> Cone:
        place = np.array([stem.right_m, stem.ahead_m])
        height = float(self.ground.height_m(place))
        foot = self.to_camera @ np.array([place[0], self.camera_height_m - height, place[1]])
        lean, towards = np.radians([stem.lean_deg, stem.lean_towards_deg])
        level = np.array(
            [np.sin(lean) * np.cos(towards), -np.cos(lean), np.sin(lean) * np.sin(towards)]
        )
        along = self.to_camera @ level
        view = foot / np.linalg.norm(foot)
        across = np.cross(view, along)
        across /= np.linalg.norm(across)
        turn = np.radians(stem.oval_turn_deg)
        longer = np.cos(turn) * across + np.sin(turn) * np.cross(along, across)
        return Cone(
            foot - BELOW_M * along,
            along,
            stem.top_m + BELOW_M,
            stem.diameter_m / 2 + BELOW_M * stem.taper / 2,
            stem.taper / 2,
            stem.oval,
            longer,
            number,
        )

    @property
    def measured(self) -> list[int]:
        """Numbers of the stems to measure."""
        return [n for n, stem in enumerate(self.stems) if stem.measured]

    def masks(self) -> list[Bool]:
        """(H, W) visible mask of each stem to measure."""
        return [self.owner == number + 1 for number in self.measured]

    def axis_m(self, number: int, height_m: float) -> Float:
        """(3,) camera point of the axis at a length above the foot."""
        cone = self.cones[number]
        return np.asarray(cone.start_m + (height_m + BELOW_M) * cone.along)

    def front_m(self, number: int, height_m: float) -> Float:
        """(3,) camera point of the bark that faces the camera there."""
        cone, centre = self.cones[number], self.axis_m(number, height_m)
        towards = (centre @ cone.along) * cone.along - centre
        radius = cone.radius_at_m(height_m + BELOW_M)
        return np.asarray(centre + radius * towards / np.linalg.norm(towards))

    def keypoints_px(self, number: int) -> Float:
        """(5, 2) exact keypoints: cut, left and right edge of the section, middle, top."""
        stem, cone = self.stems[number], self.cones[number]
        ring = project_points(self.camera, cone.section_m(stem.section_m + BELOW_M))
        ends = project_points(
            self.camera, np.stack([self.axis_m(number, stem.section_m + d) for d in (0, 0.1)])
        )
        across = np.array([ends[0, 1] - ends[1, 1], ends[1, 0] - ends[0, 0]])
        side = ring @ across
        edges = ring[[side.argmin(), side.argmax()]]
        axis = [self.axis_m(number, height) for height in (stem.top_m / 4, stem.top_m / 2)]
        points = project_points(self.camera, np.stack([self.front_m(number, stem.cut_m), *axis]))
        return np.concatenate([points[:1], edges[np.argsort(edges[:, 0])], points[1:]])

    def detections(
        self,
        rng: np.random.Generator | None = None,
        *,
        keypoints: bool = True,
        masks: list[Bool] | None = None,
    ) -> TreeDetections:
        """The stems as a detector gives them, with masks of 28x28 cells.

        Args:
            rng: Source of errors of the keypoints, as large as `MeasureSettings` says; exact
                without it.
            keypoints: Whether the detector gives keypoints.
            masks: (H, W) masks in place of the visible ones.
        """
        usual = MeasureSettings()
        boxes, grids = [], []
        for mask in self.masks() if masks is None else masks:
            rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
            box = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
            crop = mask[box[1] : box[3], box[0] : box[2]].astype(np.float32)
            boxes.append(box)
            grids.append(cv2.resize(crop, (28, 28), interpolation=cv2.INTER_AREA))
        boxes_px = np.array(boxes, np.float32)
        points = np.ones((len(grids), 5, 3))
        for index, number in enumerate(self.measured):
            exact = self.keypoints_px(number)
            if rng is not None:
                width, height = boxes_px[index, 2:] - boxes_px[index, :2]
                least = usual.keypoint_std_px * self.camera.width / 1280
                spread = np.array(
                    [usual.keypoint_spread * width, usual.keypoint_slide * np.sqrt(width * height)]
                )
                exact = exact + rng.standard_normal((5, 2)) * np.hypot(least, spread)
            size = np.array([self.camera.width, self.camera.height])
            points[index, :, :2] = exact
            points[index, :, 2] = ((exact > 0) & (exact < size)).all(1)
        return TreeDetections(
            boxes_px,
            np.ones(len(grids), np.float32),
            points.astype(np.float32) if keypoints else None,
            np.array(grids),
            self.camera.width,
            self.camera.height,
        )

    def lowest_m(self, number: int, mask: Bool) -> float:
        """Length above the foot, along the axis, of the lowest bark that a mask shows."""
        lengths = np.arange(-BELOW_M, self.stems[number].top_m, 0.005)
        points = np.stack([self.front_m(number, length) for length in lengths])
        columns, rows = np.floor(project_points(self.camera, points)).astype(int).T
        height, width = mask.shape
        seen = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
        seen[seen] = mask[rows[seen], columns[seen]]
        return float(lengths[seen.argmax()])

    def truth(self, number: int, distance_at_m: float | None = None) -> dict[str, Any]:
        """True values of a stem by the names of the measured quantities.

        Args:
            number: Its number.
            distance_at_m: Length above the foot at which the distance is taken; at the felling cut
                if None.
        """
        stem, cone = self.stems[number], self.cones[number]
        cosine = float(cone.along @ self.up)
        uphill_m = stem.diameter_m / 2 * float(np.linalg.norm(self.gradient))
        breast_m = (BREAST_HEIGHT_M + uphill_m) / cosine
        cut = self.front_m(number, stem.cut_m)
        axis = self.axis_m(number, stem.cut_m)
        at = axis if distance_at_m is None else self.axis_m(number, distance_at_m)
        return {
            "diameter_m": cone.girth_diameter_m(stem.section_m + BELOW_M),
            "dbh_m": cone.girth_diameter_m(breast_m + BELOW_M),
            "cut_height_m": stem.cut_m * cosine - uphill_m,
            "inclination_deg": stem.lean_deg,
            "distance_m": float(np.linalg.norm(at)),
            "axis_distance_m": float(np.linalg.norm(axis - (axis @ cone.along) * cone.along)),
            "cut_point_m": cut,
        }

    def readings(
        self,
        trees: TreeDetections | None = None,
        *,
        masks: list[Bool] | None = None,
        given_masks: list[Bool] | None = None,
        vertical: bool = True,
        settings: MeasureSettings | None = None,
        **options: Any,
    ) -> Iterator[tuple[TreeMeasurement, dict[str, Any]]]:
        """Measure all stems; yields each measurement with the true values.

        Without keypoints the distance is that of the lowest part that the mask shows.

        Args:
            trees: Detections in place of exact ones.
            masks: (H, W) masks that the detections have, where they are not the visible ones.
            given_masks: (H, W) masks that a caller gives.
            vertical: Whether the vertical is given.
            settings: Settings of the measurement.
            options: Further arguments of `measure_trees`.
        """
        trees = self.detections() if trees is None else trees
        found = measure_trees(
            trees,
            self.depth_m,
            self.camera,
            masks=given_masks,
            up_camera=self.up if vertical else None,
            settings=settings,
            **options,
        )
        if trees.keypoints_px is not None:
            yield from ((tree, self.truth(n)) for n, tree in zip(self.measured, found, strict=True))
            return
        shown = given_masks or masks or self.masks()
        for number, tree, mask in zip(self.measured, found, shown, strict=True):
            yield tree, self.truth(number, self.lowest_m(number, mask))
