"""What is mistaken for stems, placed before the cameras of a scene's independent views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.geometry.negatives import LOG_M
from perceptree.simulator.rendering.view import View, random_view
from perceptree.simulator.scene.description import Scene
from perceptree.simulator.scene.scatter import Placement, rotations, yaw_rotations
from perceptree.simulator.settings import NegativeSettings, SimulatorSettings
from perceptree.simulator.streams import Stream, stream
from perceptree.simulator.vectors import UP, heading, unit

_NEAREST_M, _FARTHEST_M = 1.1, 9.0
_ATTEMPTS = 12
_STEM_GAP_M, _CAMERA_GAP_M = 0.3, 0.55
_LENS_M = (0.4, 1.3)  # range of the depth of twigs at the lens
_ROW_DISTANCE_M = (9.0, 17.0)  # of a thicket from the scene's centre
_ROW_GAP = (0.75, 1.5)  # spacing in a thicket, over the width of a member
# Prototypes of thickets: height before scaling and width over height.
_BUSHES = {"sapling": (2.0, 0.5), "hedge_shrub": (1.2, 0.75), "beech_hedge_shrub": (1.2, 0.75)}
_BUSH_M = (1.8, 5.0)


@dataclass(frozen=True)
class _NearKind:
    """How a kind of object is placed: on its footprint, a capsule along its x axis.

    Attributes:
        setting: Field of NegativeSettings with the number of objects.
        reach: Range of the distance, over that of the nearest ground in the picture.
        radius_m: Radius of the capsule, m.
        half_length_m: Half of the length of its axis, m.
        scale: Range of the size factor.
        follows_slope: Whether objects are aligned with the ground's slope.
    """

    setting: str
    reach: tuple[float, float]
    radius_m: float
    half_length_m: float = 0.0
    scale: tuple[float, float] = (0.9, 1.1)
    follows_slope: bool = False


_NEAR_KINDS = {
    "near_person": _NearKind("people", (0.65, 1.8), 0.35),
    "near_animal": _NearKind("animals", (0.55, 1.8), 0.35, 0.6),
    "near_post": _NearKind("posts", (0.45, 1.8), 0.15),
    "near_log": _NearKind("logs", (0.6, 1.8), 0.25, LOG_M / 2, (0.4, 1.3), True),
    "near_stump": _NearKind("stumps", (0.8, 1.8), 0.35),
}


@dataclass(frozen=True)
class _Space:
    """What objects keep clear of.

    Attributes:
        stems: (n, 3) near stems: x, y and radius, m.
        cameras_m: (m, 2) positions.
        obstacles: (k, 3) circles around other objects: x, y and radius, m.
    """

    stems: Float
    cameras_m: Float
    obstacles: Float

    def has_room(self, points_m: Float, radius_m: float) -> bool:
        """Whether discs around points (p, 2) are free; obstacles count at the middle only."""
        stems_m = _gaps_m(points_m, self.stems[:, :2]) - self.stems[:, 2]
        cameras_m = _gaps_m(points_m, self.cameras_m)
        middle = points_m[len(points_m) // 2][None]
        others_m = _gaps_m(middle, self.obstacles[:, :2]) - self.obstacles[:, 2]
        return bool(
            stems_m.min(initial=np.inf) > radius_m + _STEM_GAP_M
            and cameras_m.min(initial=np.inf) > radius_m + _CAMERA_GAP_M
            and others_m.min(initial=np.inf) > 0
        )


def _gaps_m(points_m: Float, places_m: Float) -> Float:
    """(p, n) distances of points (p, 2) from places (n, 2)."""
    return np.asarray(np.linalg.norm(points_m[:, None] - places_m, axis=-1))


def with_foreground(settings: SimulatorSettings, scene: Scene) -> Scene:
    """Place what is mistaken for stems before the cameras of a scene's independent views.

    Args:
        settings: Settings of the simulator.
        scene: The scene; its trees and the circles that cameras avoid stay as they are.
    """
    if settings.negatives == NegativeSettings() or scene.circuit is not None:
        return scene
    views = [
        random_view(stream(scene.seed, Stream.VIEW, number), settings.camera, scene)
        for number in range(settings.views_per_scene)
    ]
    placed = _placed(stream(scene.seed, Stream.NEGATIVES), settings.negatives, scene, views)
    return replace(scene, undergrowth=scene.undergrowth + placed)


def _placed(
    rng: np.random.Generator, settings: NegativeSettings, scene: Scene, views: Sequence[View]
) -> list[Placement]:
    """Place objects before each camera, and thickets around the scene's centre."""
    stems = [[*tree.position_m[:2], tree.stem.diameter_m / 2] for tree in scene.near_trees]
    space = _Space(
        np.array(stems).reshape(-1, 3),
        np.array([view.origin[:2] for view in views]).reshape(-1, 2),
        scene.obstacles,
    )
    placed: list[Placement] = []
    for view in views:
        for name, kind in _NEAR_KINDS.items():
            for _ in range(_number(rng, settings, kind.setting)):
                found = _before(rng, name, kind, scene, view, space)
                placed += [] if found is None else [found]
        for _ in range(_number(rng, settings, "twigs")):
            placed.append(_at_lens(rng, view))
    for _ in range(_number(rng, settings, "thickets")):
        placed += _thicket(rng, scene, space)
    return placed


def _number(rng: np.random.Generator, settings: NegativeSettings, name: str) -> int:
    low, high = getattr(settings, name)
    return round(float(rng.uniform(low, high)))


def _before(
    rng: np.random.Generator, name: str, kind: _NearKind, scene: Scene, view: View, space: _Space
) -> Placement | None:
    """Place an object in view near the camera; None if no attempt finds room."""
    low, right, bottom = view.ray_bounds[0], view.ray_bounds[1], view.ray_bounds[3]
    dip_rad = np.arctan(bottom) - np.radians(view.pose.pitch_deg)
    ground_m = view.pose.height_m / np.tan(np.clip(dip_rad, 0.05, 1.5))
    scale = float(rng.uniform(*kind.scale))
    for _ in range(_ATTEMPTS):
        distance_m = np.clip(
            ground_m * np.exp(rng.uniform(*np.log(kind.reach))), _NEAREST_M, _FARTHEST_M
        )
        bearing = np.radians(view.pose.yaw_deg) - np.arctan(rng.uniform(0.9 * low, 0.9 * right))
        middle = view.origin[:2] + distance_m * heading(bearing)
        turn = rng.uniform(0, 2 * np.pi)
        along = np.linspace(-1, 1, 9)[:, None] * kind.half_length_m * scale
        points_m = middle + along * [np.cos(turn), np.sin(turn)]
        if space.has_room(points_m, kind.radius_m * scale):
            x, y, turns = middle[:1], middle[1:], np.array([turn])
            rotation = rotations(scene.terrain, x, y, turns, kind.follows_slope)
            height_m = float(scene.terrain.height_m(*middle))
            return _placement(rng, name, np.array([*middle, height_m]), rotation, scale)
    return None


def _at_lens(rng: np.random.Generator, view: View) -> Placement:
    """Place a twig at the lens, from outside the picture's border inwards, mostly from above."""
    left, right, top, bottom = view.ray_bounds
    depth_m = rng.uniform(*_LENS_M)
    edge, across = rng.choice(3, p=(0.5, 0.25, 0.25)), rng.random()
    x = left + across * (right - left) if edge == 0 else 1.1 * (left if edge == 1 else right)
    y = 1.1 * top if edge == 0 else top + across * (bottom - top)
    aim = np.array([rng.uniform(0.5 * left, 0.5 * right), rng.uniform(0.5 * top, 0.5 * bottom)])
    inwards = np.array([*(aim - [x, y]), rng.uniform(-0.2, 0.6)])
    origin = view.origin + depth_m * np.array([x, y, 1.0]) @ view.rotation
    first = unit(inwards @ view.rotation)
    second = unit(np.cross(UP, first))
    rotation = np.stack([first, second, np.cross(first, second)], -1)
    return _placement(rng, "lens_twig", origin, rotation[None], float(rng.uniform(0.4, 0.9)))


def _thicket(rng: np.random.Generator, scene: Scene, space: _Space) -> list[Placement]:
    """Place a row of bushes or young conifers with gaps of less than a width."""
    kind = list(_BUSHES)[rng.integers(len(_BUSHES))]
    size_m, aspect = _BUSHES[kind]
    tall_m, count = rng.uniform(*_BUSH_M), int(rng.integers(4, 11))
    spacing_m = tall_m * aspect * rng.uniform(*_ROW_GAP)
    bearing, turn = rng.uniform(0, 2 * np.pi), rng.normal(np.pi / 2, 0.4)
    middle = rng.uniform(*_ROW_DISTANCE_M) * heading(bearing)
    row = spacing_m * (np.arange(count) - (count - 1) / 2) + rng.normal(0, 0.15, count) * spacing_m
    along = heading(bearing + turn)
    places = middle + row[:, None] * along + rng.normal(0, 0.3, (count, 2))
    members = []
    for place in places:
        scale = tall_m * rng.uniform(0.75, 1.2) / size_m
        if space.has_room(place[None], 0.5):
            position = np.array([*place, float(scene.terrain.height_m(*place))])
            yaw = yaw_rotations(rng.uniform(0, 2 * np.pi, 1))
            members.append(_placement(rng, kind, position, yaw, float(scale)))
    return members


def _placement(
    rng: np.random.Generator, kind: str, position_m: Float, rotation: Float, scale: float
) -> Placement:
    return Placement(
        kind,
        position_m[None],
        rotation,
        np.array([scale]),
        rng.uniform(0.8, 1.2, 1),
        rng.random(1),
    )
