"""Cast rays at cones, ground and layers of plants."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Index
from calib import PinholeCamera, pixels_to_rays

FARTHEST_M = 60.0
GROUND, PLANTS, NOTHING = 0, -2, -1


@dataclass(frozen=True, eq=False)
class Cone:
    """A cone or cylinder with a round or oval section, in camera coordinates.

    Attributes:
        start_m: (3,) point of the axis at its lower end.
        along: (3,) unit vector of the axis.
        length_m: Length of the axis.
        radius_m: Radius at the lower end; of an oval section the geometric mean of both half axes.
        narrowing: Decrease of the radius per metre along the axis.
        oval: Ratio of the longer to the shorter half axis.
        oval_across: (3,) direction of the longer half axis, at right angles to `along`.
        owner: Number in the image of owners.
    """

    start_m: Float
    along: Float
    length_m: float
    radius_m: float
    narrowing: float = 0.0
    oval: float = 1.0
    oval_across: Float | None = None
    owner: int = PLANTS

    def sides(self) -> tuple[Float, Float]:
        """Two unit vectors across the axis, along the longer and the shorter half axis."""
        across = self.oval_across
        if across is None:
            across = np.eye(3)[np.abs(self.along).argmin()]
        across = across - (across @ self.along) * self.along
        across = across / np.linalg.norm(across)
        return across, np.cross(self.along, across)

    def radius_at_m(self, length_m: float) -> float:
        """The radius at a place along the axis."""
        return self.radius_m - self.narrowing * length_m

    def section_m(self, length_m: float, count: int = 720) -> Float:
        """(count, 3) points around the section at a place along the axis."""
        turn = np.linspace(0, 2 * np.pi, count, endpoint=False)[:, None]
        longer, shorter = self.sides()
        radius, ratio = self.radius_at_m(length_m), np.sqrt(self.oval)
        centre = self.start_m + length_m * self.along
        oval = ratio * np.cos(turn) * longer + np.sin(turn) / ratio * shorter
        return np.asarray(centre + radius * oval)

    def girth_diameter_m(self, length_m: float) -> float:
        """Girth divided by pi at a place along the axis, as a tape tells it."""
        points = self.section_m(length_m)
        return float(np.linalg.norm(points - np.roll(points, 1, axis=0), axis=1).sum() / np.pi)

    def cast(self, rays: Float) -> Float:
        """(...) depth z of the surface on rays (..., 3) with z = 1; infinite where they miss it."""
        longer, shorter = self.sides()
        ratio = np.sqrt(self.oval)
        u, v, h = rays @ longer / ratio, rays @ shorter * ratio, rays @ self.along
        u0, v0 = -(self.start_m @ longer) / ratio, -(self.start_m @ shorter) * ratio
        h0 = -(self.start_m @ self.along)
        radius = self.radius_m - self.narrowing * h0
        a = u**2 + v**2 - (self.narrowing * h) ** 2
        b = u * u0 + v * v0 + radius * self.narrowing * h
        root = b**2 - a * (u0**2 + v0**2 - radius**2)
        z = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
        height = np.where(np.isfinite(z), z, 0) * h + h0
        seen = (z > 0) & (height >= 0) & (height <= self.length_m)
        return np.asarray(np.where(seen, z, np.inf))


@dataclass(frozen=True, eq=False)
class Ground:
    """Sloping ground with bumps, and plants or snow on it.

    Attributes:
        camera_height_m: Height of the camera above the ground below it.
        gradient: (2,) rise of the ground to the right and ahead, metres per metre.
        bumps_m: (N, N) heights of bumps, one a cell; they repeat.
        bump_cell_m: Size of these cells.
        plants_m: (N, N) heights of plants, 0 where there are none; they repeat.
        plant_cell_m: Size of these cells.
        around_m: (P, 2) plants stand within `reach_m` of these places, right and ahead.
        reach_m: How far.
    """

    camera_height_m: float
    gradient: Float
    bumps_m: Float
    bump_cell_m: float = 0.3
    plants_m: Float | None = None
    plant_cell_m: float = 0.05
    around_m: Float | None = None
    reach_m: float = 3.0

    def bump_at_m(self, at_m: Float) -> Float:
        """(...) heights of bumps at places (..., 2), right and ahead."""
        x, y = (np.asarray(at_m[..., axis] / self.bump_cell_m) for axis in (0, 1))
        size = len(self.bumps_m)
        column, row = np.floor(x).astype(int), np.floor(y).astype(int)
        right, below = x - column, y - row
        low = (
            self._cell(row, column, size) * (1 - right) + self._cell(row, column + 1, size) * right
        )
        high = self._cell(row + 1, column, size) * (1 - right)
        high = high + self._cell(row + 1, column + 1, size) * right
        return np.asarray(low * (1 - below) + high * below)

    def _cell(self, row: Index, column: Index, size: int) -> Float:
        return np.asarray(self.bumps_m[row % size, column % size])

    def height_m(self, at_m: Float) -> Float:
        """(...) heights of the ground above that below the camera, without plants."""
        return np.asarray(at_m @ self.gradient + self.bump_at_m(at_m))

    def cast(self, level: Float) -> tuple[Float, Bool]:
        """Depth (...) of ground or plants, and where it is that of plants.

        Args:
            level: (..., 3) rays in level axes: right, down, ahead; scaled so that z = 1 in the
                camera's axes.
        """
        falling = level[..., 1] + level[..., [0, 2]] @ self.gradient
        hit = falling > 1e-6
        safe = np.where(hit, falling, 1.0)
        z = np.where(hit, self.camera_height_m / safe, np.inf)
        for _ in range(3):
            flat = np.where(hit, z, 0.0)[..., None] * level[..., [0, 2]]
            z = np.where(hit, (self.camera_height_m - self.bump_at_m(flat)) / safe, np.inf)
        if self.plants_m is None:
            return z, np.zeros(z.shape, np.bool_)
        plants = self._cast_plants(level, falling, z)
        return np.minimum(plants, z), plants < z

    def _cast_plants(self, level: Float, falling: Float, ground: Float) -> Float:
        assert self.plants_m is not None
        at = np.where(np.isfinite(ground), ground, 0.0)[..., None] * level[..., [0, 2]]
        near = np.isfinite(ground) & (ground < FARTHEST_M)
        if self.around_m is not None:
            apart = np.linalg.norm(at[..., None, :] - self.around_m, axis=-1).min(-1)
            near &= apart < self.reach_m
        rows, columns = np.nonzero(near)
        across, fall = level[rows, columns][:, [0, 2]], falling[rows, columns]
        top, found = float(self.plants_m.max()), np.full(len(rows), np.inf)
        run_m = top / fall * np.linalg.norm(across, axis=1)
        steps = int(np.clip(np.ceil(2 * run_m.max(initial=0.0) / self.plant_cell_m), 4, 400))
        size = len(self.plants_m)
        for height in np.linspace(top, 0.0, steps, endpoint=False):
            z = (self.camera_height_m - height) / fall
            cell = np.floor(z[:, None] * across / self.plant_cell_m).astype(int) % size
            hit = np.isinf(found) & (self.plants_m[cell[:, 0], cell[:, 1]] >= height)
            found[hit] = z[hit]
        result = np.full(ground.shape, np.inf)
        result[rows, columns] = found
        return result


def cast(
    camera: PinholeCamera, to_camera: Float, ground: Ground, cones: list[Cone]
) -> tuple[Float, Index]:
    """Depth (H, W) in metres, 0 beyond `FARTHEST_M`, and the owner of each pixel.

    Args:
        camera: The camera, with or without distortion.
        to_camera: (3, 3) rotation from level axes to those of the camera.
        ground: The ground.
        cones: Everything else.
    """
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5)
    depth_m, plants = ground.cast(rays @ to_camera)
    owner = np.where(plants, PLANTS, np.where(np.isfinite(depth_m), GROUND, NOTHING))
    for cone in cones:
        view = _view(camera, cone)
        if view is None:
            continue
        z = cone.cast(rays[view])
        nearer = z < depth_m[view]
        depth_m[view] = np.where(nearer, z, depth_m[view])
        owner[view] = np.where(nearer, cone.owner, owner[view])
    return np.where(depth_m < FARTHEST_M, depth_m, 0.0).astype(np.float32), owner


def _view(camera: PinholeCamera, cone: Cone) -> tuple[slice, slice] | None:
    """Rows and columns that hold a cone; None if it is outside the image."""
    ends = np.stack([cone.start_m, cone.start_m + cone.length_m * cone.along])
    thick = max(cone.radius_m, cone.radius_at_m(cone.length_m)) * np.sqrt(cone.oval) * 1.05
    nearest = ends[:, 2].min() - thick
    if nearest < 0.2 or camera.distortion:
        return slice(None), slice(None)
    x = camera.fx * ends[:, 0] / ends[:, 2] + camera.cx
    y = camera.fy * ends[:, 1] / ends[:, 2] + camera.cy
    reach = 2 * thick * camera.fx / nearest + 2
    left, right = (int(np.clip(at, 0, camera.width)) for at in (x.min() - reach, x.max() + reach))
    top, low = (int(np.clip(at, 0, camera.height)) for at in (y.min() - reach, y.max() + reach))
    return (slice(top, low), slice(left, right)) if right > left and low > top else None


def smooth_noise(rng: np.random.Generator, size: int, std: float) -> Float:
    """(size, size) smooth random heights with a standard deviation; they repeat."""
    noise = rng.standard_normal((size, size))
    tiled = cv2.GaussianBlur(np.tile(noise, (3, 3)), (0, 0), 1.5)[size : 2 * size, size : 2 * size]
    return np.asarray(tiled / tiled.std() * std)
