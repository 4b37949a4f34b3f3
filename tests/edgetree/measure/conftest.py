"""Synthetic scenes of stems, grass and walls on planes, with exact keypoints, depth and truth.

The scenes are ray traced here, independently of the simulator and of the code under test. Only the
pinhole projection is shared; `tests/calib` compares it with OpenCV.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import ClassVar

import cv2
import numpy as np
import pytest

from calib import PinholeCamera, pixels_to_rays, project_points
from edgetree import TreeDetections
from edgetree.measure import EXACT_RIG, MeasureSettings, TreeMeasurement, measure_trees

CAMERA = PinholeCamera(1280, 720, 700.0, 700.0, 639.5, 359.5)

EXACT = MeasureSettings(
    keypoint_std_px=0.1,
    keypoint_spread=1e-6,
    keypoint_slide=1e-6,
    mask_std_px=0.5,
    mask_spread=0.1,
    depth_noise_m=1e-4,
    depth_bias_per_m=1e-6,
    outline_doubt=1e-6,
    readings_doubt=1e-6,
    butt_swell=1e-6,
    out_of_round_std=1e-6,
    bend_std_deg=1e-6,
)
"""Settings for exact keypoints and depth, and for perfectly round stems."""


@dataclass(frozen=True)
class Pole:
    """A cylindrical or conical stem on the ground; positions are relative to the camera, in metres.

    The diameter shrinks by `taper` metres per metre along the axis.
    """

    diameter_m: float = 0.3
    right_m: float = 0.0
    ahead_m: float = 5.0
    lean_deg: float = 0.0
    lean_towards_deg: float = 0.0
    """Direction of the lean: 0 to the right of the image, 90 away from the camera."""
    cut_m: float = 0.25
    section_m: float = 0.4
    top_m: float = 3.0
    taper: float = 0.0

    def diameter_at_m(self, height_m: float) -> float:
        """Diameter at a height along the axis."""
        return self.diameter_m - self.taper * height_m


@dataclass(frozen=True)
class Grass:
    """Upright columns with square bases and random heights, on a share of the ground.

    The grass stands within `RADIUS_M` of the stems. Heights are uniform between `low` and 1 times
    `height_m`.
    """

    height_m: float = 0.3
    share: float = 0.7
    column_m: float = 0.05
    low: float = 0.3
    seed: int = 0
    RADIUS_M: ClassVar[float] = 2.0

    def heights_m(self, right_m: np.ndarray, ahead_m: np.ndarray) -> np.ndarray:
        """Heights at horizontal positions; the pattern repeats after 256 columns."""
        rng = np.random.default_rng(self.seed)
        heights_m = self.height_m * rng.uniform(self.low, 1, (256, 256))
        heights_m[rng.random((256, 256)) >= self.share] = 0
        cells = [np.floor(at / self.column_m).astype(int) % 256 for at in (right_m, ahead_m)]
        return heights_m[cells[0], cells[1]]


@dataclass(frozen=True)
class Wall:
    """A box with vertical sides. With a roughness, its faces are as uneven as a hedge.

    The position is that of its middle. `turned_deg` turns it from crossing the view to along it.
    """

    right_m: float
    ahead_m: float
    width_m: float = 4.0
    thickness_m: float = 0.4
    height_m: float = 1.2
    turned_deg: float = 0.0
    roughness_m: float = 0.0


@dataclass
class Scene:
    """Poles on sloping ground in front of a camera.

    The ground rises by `slope_deg` towards `uphill_deg`, which is defined like
    `Pole.lean_towards_deg`.
    """

    poles: list[Pole]
    camera: PinholeCamera = CAMERA
    camera_height_m: float = 1.8
    pitch_deg: float = 8.0
    roll_deg: float = 0.0
    slope_deg: float = 0.0
    uphill_deg: float = 90.0
    grass: Grass | None = None
    walls: tuple[Wall, ...] = ()
    depth_m: np.ndarray = field(init=False)
    owner: np.ndarray = field(init=False)
    """(H, W) number of the pole that a pixel shows, from 1; 0 for ground and -1 for nothing, -2
    for grass and walls."""

    def __post_init__(self) -> None:
        pitch, roll = np.radians([self.pitch_deg, self.roll_deg])
        nod = np.array(
            [[1, 0, 0], [0, np.cos(pitch), -np.sin(pitch)], [0, np.sin(pitch), np.cos(pitch)]]
        )
        turn = np.array(
            [[np.cos(roll), -np.sin(roll), 0], [np.sin(roll), np.cos(roll), 0], [0, 0, 1]]
        )
        # Rotation from level axes (right, down, forward) to camera axes.
        self.to_camera = turn @ nod
        self.up = self.to_camera @ np.array([0.0, -1.0, 0.0])
        slope, uphill = np.radians([self.slope_deg, self.uphill_deg])
        self.gradient = np.tan(slope) * np.array([np.cos(uphill), np.sin(uphill)])
        self._cast()

    def foot(self, pole: Pole) -> np.ndarray:
        """(3,) camera point at which the axis meets the ground."""
        rise = self.gradient @ (pole.right_m, pole.ahead_m)
        level = np.array([pole.right_m, self.camera_height_m - rise, pole.ahead_m])
        return self.to_camera @ level

    def along(self, pole: Pole) -> np.ndarray:
        lean, towards = np.radians([pole.lean_deg, pole.lean_towards_deg])
        sine = np.sin(lean)
        level = np.array([sine * np.cos(towards), -np.cos(lean), sine * np.sin(towards)])
        return self.to_camera @ level

    def axis_point(self, pole: Pole, height_m: float) -> np.ndarray:
        return self.foot(pole) + height_m * self.along(pole)

    def front(self, pole: Pole, centre: np.ndarray) -> np.ndarray:
        """(3,) unit vector across the axis, from the axis to the camera."""
        along = self.along(pole)
        towards = (centre @ along) * along - centre
        return towards / np.linalg.norm(towards)

    def edges(self, pole: Pole) -> np.ndarray:
        """(2, 3) camera points at which rays touch the section, left then right."""
        radius = pole.diameter_at_m(pole.section_m) / 2
        centre, along = self.axis_point(pole, pole.section_m), self.along(pole)
        front = self.front(pole, centre)
        rise = pole.taper / 2 * (centre @ along)
        cosine = (radius + rise) / np.linalg.norm(centre - (centre @ along) * along)
        side = np.cross(along, front)
        points = centre + radius * np.stack(
            [cosine * front + sign * np.sqrt(1 - cosine**2) * side for sign in (-1, 1)]
        )
        return points[np.argsort(project_points(self.camera, points)[:, 0])]

    def cut_point(self, pole: Pole) -> np.ndarray:
        centre = self.axis_point(pole, pole.cut_m)
        return centre + pole.diameter_at_m(pole.cut_m) / 2 * self.front(pole, centre)

    def cut_height_m(self, pole: Pole) -> float:
        """Vertical height of the axis at the cut above the ground on the uphill side."""
        uphill = pole.diameter_m / 2 * np.linalg.norm(self.gradient)
        return pole.cut_m * np.cos(np.radians(pole.lean_deg)) - uphill

    def keypoints(self, pole: Pole) -> np.ndarray:
        """(5, 2) keypoints in pixels."""
        middle = (pole.cut_m + pole.top_m / 2) / 2
        axis = [self.axis_point(pole, height) for height in (middle, pole.top_m / 2)]
        points = np.stack([self.cut_point(pole), *self.edges(pole), *axis])
        return project_points(self.camera, points)

    def _cast(self) -> None:
        camera = self.camera
        rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
        rays = pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)
        level = rays @ self.to_camera
        # The ground: down = camera height - gradient . (right, ahead).
        falling = level[..., 1] + level[..., [0, 2]] @ self.gradient
        hit = falling > 1e-6
        depth = np.where(hit, self.camera_height_m / np.where(hit, falling, 1.0), np.inf)
        self.owner = np.where(hit, 0, -1)
        for number, pole in enumerate(self.poles, start=1):
            z = self._cast_pole(pole, rays)
            nearer = z < depth
            depth, self.owner = np.where(nearer, z, depth), np.where(nearer, number, self.owner)
        things = [self._cast_wall(wall, level) for wall in self.walls]
        for z in things + ([] if self.grass is None else [self._cast_grass(self.grass, level)]):
            nearer = z < depth
            depth, self.owner = np.where(nearer, z, depth), np.where(nearer, -2, self.owner)
        self.depth_m = np.where(depth < 60, depth, 0).astype(np.float32)

    def _cast_pole(self, pole: Pole, rays: np.ndarray) -> np.ndarray:
        foot, along = self.foot(pole), self.along(pole)
        climb = rays @ along
        flat = rays - climb[..., None] * along
        centre = foot - (foot @ along) * along
        # |z flat - centre| is the radius, which shrinks with the height z climb - foot . along.
        narrowing = pole.taper / 2
        radius = pole.diameter_m / 2 + narrowing * (foot @ along)
        a = (flat**2).sum(-1) - (narrowing * climb) ** 2
        b = flat @ centre - narrowing * climb * radius
        root = b**2 - a * (centre @ centre - radius**2)
        z = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        height = np.where(np.isfinite(z), z, 0) * climb - foot @ along
        return np.where((height > -1) & (height < pole.top_m) & (z > 0), z, np.inf)

    def _cast_grass(self, grass: Grass, level: np.ndarray) -> np.ndarray:
        """(H, W) depth of the grass, found in steps of half a column along each ray."""
        falling = level[..., 1] + level[..., [0, 2]] @ self.gradient
        falls = falling > 1e-3
        ground = np.where(falls, self.camera_height_m / np.where(falls, falling, 1.0), np.inf)
        feet = np.array([[pole.right_m, pole.ahead_m] for pole in self.poles])
        at = np.where(falls, ground, 0.0)[..., None] * level[..., [0, 2]]
        apart_m = np.linalg.norm(at[..., None, :] - feet, axis=-1).min(-1)
        rows, columns = np.nonzero(falls & (apart_m < grass.RADIUS_M))
        z_ground, across = ground[rows, columns], level[rows, columns][:, [0, 2]]
        travel_m = grass.height_m / self.camera_height_m * z_ground * np.linalg.norm(across, axis=1)
        steps = int(np.ceil(2 * travel_m.max(initial=0.0) / grass.column_m)) + 1
        result = np.full(ground.shape, np.inf)
        found = np.full(len(rows), np.inf)
        for height_m in np.linspace(grass.height_m, 0.0, steps, endpoint=False):
            z = z_ground * (1 - height_m / self.camera_height_m)
            at = z[:, None] * across
            hit = np.isinf(found) & (grass.heights_m(at[:, 0], at[:, 1]) > height_m)
            found[hit] = z[hit]
        result[rows, columns] = found
        return result

    def _cast_wall(self, wall: Wall, level: np.ndarray) -> np.ndarray:
        """(H, W) depth of a wall whose middle is at the height of the ground there."""
        turned = np.radians(wall.turned_deg)
        sides = np.array([[np.cos(turned), np.sin(turned)], [-np.sin(turned), np.cos(turned)]])
        middle = np.array([wall.right_m, wall.ahead_m])
        base_m = self.camera_height_m - self.gradient @ middle
        rays = np.concatenate([level[..., [0, 2]] @ sides.T, level[..., 1:2]], -1)
        centre = np.array([*(sides @ middle), base_m])
        half = np.array([wall.width_m / 2, wall.thickness_m / 2, wall.height_m])
        rays = np.where(np.abs(rays) < 1e-9, 1e-9, rays)
        near, far = (centre - half) / rays, (centre + half) / rays
        enter, leave = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
        hit = (enter < leave) & (enter > 0)
        bumps = np.random.default_rng(1).uniform(0, wall.roughness_m, (64, 64))
        at = np.where(hit, enter, 0.0)[..., None] * rays
        cells = [np.floor(at[..., axis] / 0.06).astype(int) % 64 for axis in (0, 2)]
        return np.where(hit, enter + bumps[cells[0], cells[1]], np.inf)

    def masks(self) -> list[np.ndarray]:
        """Visible mask (H, W) bool of each pole."""
        return [self.owner == number + 1 for number in range(len(self.poles))]

    def detections(self, masks: list[np.ndarray] | None = None) -> TreeDetections:
        """Detections with exact keypoints; `masks` (H, W) bool replace the visible masks."""
        boxes, grids = [], []
        for mask in masks or self.masks():
            rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
            box = [columns[0], rows[0], columns[-1] + 1, rows[-1] + 1]
            crop = mask[box[1] : box[3], box[0] : box[2]].astype(np.float32)
            boxes.append(box)
            grids.append(cv2.resize(crop, (28, 28), interpolation=cv2.INTER_AREA))
        keypoints = np.ones((len(grids), 5, 3))
        for index, pole in enumerate(self.poles):
            keypoints[index, :, :2] = self.keypoints(pole)
        return TreeDetections(
            boxes_px=np.array(boxes, np.float32),
            scores=np.ones(len(grids), np.float32),
            keypoints_px=keypoints.astype(np.float32),
            masks=np.array(grids),
            image_width=self.camera.width,
            image_height=self.camera.height,
        )

    def measure(
        self,
        trees: TreeDetections | None = None,
        depth_m: np.ndarray | None = None,
        *,
        level: bool = False,
        settings: MeasureSettings | None = EXACT,
        **options: object,
    ) -> TreeMeasurement:
        """Measure a scene with one tree, by an exact rig; `level` measures without a vertical."""
        options.setdefault("rig_uncertainty", EXACT_RIG)
        [tree] = measure_trees(
            self.detections() if trees is None else trees,
            self.depth_m if depth_m is None else depth_m,
            self.camera,
            up_camera=None if level else self.up,
            settings=settings,
            **options,  # type: ignore[arg-type]
        )
        return tree

    def measure_mask(self, mask: np.ndarray | None = None, **options: object) -> TreeMeasurement:
        """Measure one tree by an (H, W) bool mask and depth, without keypoints."""
        mask = self.owner == 1 if mask is None else mask
        trees = replace(self.detections([mask]), keypoints_px=None, masks=None)
        return self.measure(trees, masks=[mask], **options)  # type: ignore[arg-type]

    def noisy_depth_m(self, seed: int, noise_per_m: float = 0.002) -> np.ndarray:
        """Depth with stereo noise: it grows with z² and is constant in blocks of 4x4 pixels."""
        rng = np.random.default_rng(seed)
        height, width = self.depth_m.shape
        coarse = rng.standard_normal((height // 4 + 1, width // 4 + 1))
        noise = coarse.repeat(4, 0).repeat(4, 1)[:height, :width]
        return (self.depth_m + noise_per_m * self.depth_m**2 * noise).astype(np.float32)


@pytest.fixture(scope="session")
def exact() -> MeasureSettings:
    return EXACT


@pytest.fixture(scope="session")
def pole() -> type[Pole]:
    return Pole


@pytest.fixture(scope="session")
def grass() -> type[Grass]:
    return Grass


@pytest.fixture(scope="session")
def wall() -> type[Wall]:
    return Wall


@pytest.fixture(scope="session")
def scene() -> Callable[..., Scene]:
    """Build a scene: `scene(pole(...), ..., slope_deg=10)`."""

    def build(*poles: Pole, **options: object) -> Scene:
        return Scene(list(poles), **options)  # type: ignore[arg-type]

    return build
