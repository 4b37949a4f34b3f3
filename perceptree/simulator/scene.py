"""The scene: which tree, tuft and branch stands where, as flat arrays that know no renderer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.light import Light, make_light, sky_visibility
from perceptree.simulator.mesh import Mesh
from perceptree.simulator.settings import LabelSettings, SimulatorSettings, StandSettings
from perceptree.simulator.terrain import EXTENT_M, Terrain, make_terrain
from perceptree.simulator.trees import (
    Stem,
    beech_crown,
    fir_crown,
    fit_crown,
    random_stem,
    stem_mesh,
)
from perceptree.simulator.undergrowth import fallen_branch, fern, grass_tuft, scrub, stump

Float = NDArray[np.floating[Any]]

NEAR_M = 18.0
VIEW_RADIUS_M = 6.0
_UNDERGROWTH_M = 21.0


@dataclass(frozen=True)
class Tree:
    """One tree that can be labelled: its stem, where it stands, and its labels' heights.

    ``position_m`` (3,) is the foot of the axis on the ground; the heights are along the stem's
    local z, above that foot. ``cut_height_m`` is above the ground on the uphill side.
    """

    stem: Stem
    position_m: Float
    cut_z_m: float
    diameter_z_m: float
    top_z_m: float
    cut_height_m: float

    def point(self, height_m: float) -> Float:
        """(3,) world point of the axis at a height above the foot."""
        return np.asarray(self.position_m + self.stem.axis(np.array(height_m)))

    def ring(self, height_m: float, sides: int = 96) -> Float:
        """(sides, 3) world points of the bark around the axis at a height above the foot."""
        return np.asarray(self.position_m + self.stem.rings(np.array([height_m]), sides)[0, :-1])


@dataclass(frozen=True)
class Scene:
    """Flat arrays of everything visible. World axes: x east, y north, z up, metres.

    ``object_id`` (F,) is the number of the tree (from 1) whose labelled stem a face belongs to,
    else 0. Faces of one instance follow each other: ``instance_start`` (I + 1,), with bounding
    spheres ``instance_centre`` (I, 3) and ``instance_radius`` (I,).
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    uv: NDArray[np.float32]
    tint: NDArray[np.float32]
    sky: NDArray[np.float32]
    faces: NDArray[np.int32]
    layer: NDArray[np.uint8]
    object_id: NDArray[np.int32]
    instance_start: NDArray[np.int64]
    instance_centre: Float
    instance_radius: Float
    trees: list[Tree]
    terrain: Terrain
    light: Light
    seed: int


@dataclass(frozen=True)
class Prototypes:
    """Meshes shared by all scenes: crowns near and far, and undergrowth by kind."""

    crowns: dict[tuple[str, bool], list[Mesh]]
    undergrowth: dict[str, list[Mesh]]


def make_prototypes(seed: int = 5) -> Prototypes:
    """Grow the shared meshes; the same seed gives the same meshes."""
    rng = np.random.default_rng(seed)
    crowns = {
        ("fir", True): [fir_crown(rng, True) for _ in range(8)],
        ("beech", True): [beech_crown(rng, True) for _ in range(7)],
        ("fir", False): [fir_crown(rng, False) for _ in range(4)],
        ("beech", False): [beech_crown(rng, False) for _ in range(3)],
    }
    kinds: dict[str, tuple[Callable[[np.random.Generator], Mesh], int]] = {
        "grass": (grass_tuft, 6),
        "fern": (fern, 3),
        "scrub": (scrub, 3),
        "branch": (fallen_branch, 8),
        "stump": (stump, 3),
    }
    undergrowth = {name: [make(rng) for _ in range(n)] for name, (make, n) in kinds.items()}
    return Prototypes(crowns, undergrowth)


class _Assembly:
    """Collects placed meshes and lays them out as the scene's flat arrays."""

    def __init__(self) -> None:
        self.columns: dict[str, list[NDArray[Any]]] = {
            name: [] for name in ("vertices", "normals", "uv", "tint", "faces", "layer", "object")
        }
        self.face_counts: list[NDArray[np.int64]] = []
        self.centres: list[Float] = []
        self.radii: list[Float] = []
        self.vertex_count = 0

    def add(self, mesh: Mesh, position_m: Float, turn_rad: Float, scale: Float, tint: Float,
            object_id: int = 0) -> None:  # fmt: skip
        """Place one mesh n times: position (n, 3), turn, scale and tint (n,)."""
        count, size = len(position_m), len(mesh.vertices)
        cos, sin = np.cos(turn_rad)[:, None], np.sin(turn_rad)[:, None]

        def turned(v: Float) -> Float:
            return np.stack(
                [cos * v[:, 0] - sin * v[:, 1], sin * v[:, 0] + cos * v[:, 1],
                 np.broadcast_to(v[:, 2], (count, size))], -1,
            )  # fmt: skip

        placed = turned(mesh.vertices) * scale[:, None, None] + position_m[:, None]
        shift = self.vertex_count + np.arange(count)[:, None, None] * size
        columns = self.columns
        columns["vertices"].append(placed.reshape(-1, 3).astype(np.float32))
        columns["normals"].append(turned(mesh.normals).reshape(-1, 3).astype(np.float32))
        columns["uv"].append(np.tile(mesh.uv, (count, 1)).astype(np.float32))
        columns["tint"].append((mesh.tint * tint[:, None]).ravel().astype(np.float32))
        columns["faces"].append((mesh.faces[None] + shift).reshape(-1, 3).astype(np.int32))
        columns["layer"].append(np.tile(mesh.layer, count))
        columns["object"].append(np.tile(mesh.labelled * np.int32(object_id), count))
        self.face_counts.append(np.full(count, len(mesh.faces), np.int64))
        low, high = placed.min(1), placed.max(1)
        self.centres.append((low + high) / 2)
        self.radii.append(np.linalg.norm(high - low, axis=-1) / 2)
        self.vertex_count += count * size

    def place(self, mesh: Mesh, position_m: Float, object_id: int = 0) -> None:
        """Place one mesh once, as it is."""
        one = np.ones(1)
        self.add(mesh, np.asarray(position_m, float)[None], 0 * one, one, one, object_id)

    def scene(self, trees: list[Tree], terrain: Terrain, light: Light, seed: int) -> Scene:
        """The flat arrays of everything placed so far."""
        columns = {name: np.concatenate(parts) for name, parts in self.columns.items()}
        sky = sky_visibility(columns["vertices"], columns["faces"], columns["layer"])
        starts = np.concatenate([[0], np.cumsum(np.concatenate(self.face_counts))])
        return Scene(
            columns["vertices"], columns["normals"], columns["uv"], columns["tint"], sky,
            columns["faces"], columns["layer"], columns["object"].astype(np.int32), starts,
            np.concatenate(self.centres), np.concatenate(self.radii), trees, terrain, light, seed,
        )  # fmt: skip


def _stand_positions(rng: np.random.Generator, settings: StandSettings) -> Float:
    """(n, 2) stem positions over the whole extent, none closer than the spacing."""
    density = rng.uniform(*settings.stems_per_ha) / 1e4
    wanted = int(density * (2 * EXTENT_M) ** 2)
    candidates = rng.uniform(-EXTENT_M + 1, EXTENT_M - 1, (4 * wanted, 2))
    kept = np.empty((0, 2))
    for point in candidates:
        if len(kept) == wanted:
            break
        if not len(kept) or (np.hypot(*(kept - point).T) > settings.spacing_m).all():
            kept = np.concatenate([kept, point[None]])
    return kept


def _plant(stem: Stem, foot: Float, terrain: Terrain, labels: LabelSettings) -> Tree:
    """Set a stem on the ground and its label heights above the uphill side."""
    radius = 0.6 * stem.diameter_m
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    around = terrain.height_m(foot[0] + radius * np.cos(angle), foot[1] + radius * np.sin(angle))
    uphill = max(0.0, float(around.max()) - float(foot[2]))
    return Tree(
        stem, foot, uphill + labels.cut_height_m, uphill + labels.diameter_height_m,
        labels.stem_height_m, labels.cut_height_m,
    )  # fmt: skip


def _grow_stand(rng: np.random.Generator, assembly: _Assembly, prototypes: Prototypes,
                settings: SimulatorSettings, terrain: Terrain) -> list[Tree]:  # fmt: skip
    stand, trees = settings.stand, []
    fir_share = rng.uniform(*stand.fir_share)
    for x, y in _stand_positions(rng, stand):
        species = "fir" if rng.random() < fir_share else "beech"
        diameter = stand.diameter_median_m * np.exp(rng.normal(0, stand.diameter_log_std))
        diameter = float(np.clip(diameter, *stand.diameter_m))
        stem = random_stem(rng, species, diameter, stand.lean_std_deg, stand.lean_max_deg)
        foot = np.array([x, y, float(terrain.height_m(x, y))])
        near = bool(np.hypot(x, y) < NEAR_M)
        crowns = prototypes.crowns[species, near]
        crown = crowns[rng.integers(len(crowns))]
        tree = _plant(stem, foot, terrain, settings.labels)
        if near:
            trees.append(tree)
        heights = (tree.cut_z_m, tree.diameter_z_m, tree.top_z_m)
        tint = rng.uniform(0.75, 1.15)
        bark = stem_mesh(stem, heights, near)
        assembly.add(bark, foot[None], np.zeros(1), np.ones(1), np.array([tint]),
                     len(trees) if near else 0)  # fmt: skip
        assembly.place(fit_crown(crown, stem, rng.uniform(0, 2 * np.pi), tint), foot)
    return trees


def _scatter(rng: np.random.Generator, assembly: _Assembly, prototypes: Prototypes,
             share: float, terrain: Terrain) -> None:  # fmt: skip
    """Undergrowth in clusters, denser where the camera stands."""
    phase = rng.uniform(0, 2 * np.pi, 2)
    for kind, count, threshold, scale in (
        ("grass", 5200, 0.0, (0.5, 1.3)), ("fern", 260, 0.1, (0.6, 1.3)),
        ("scrub", 150, -0.2, (0.6, 1.6)), ("branch", 200, -2.0, (0.6, 1.4)),
        ("stump", 14, -2.0, (0.7, 1.2)),
    ):  # fmt: skip
        number = int(count * share)
        distance = _UNDERGROWTH_M * rng.random(number) ** 0.6
        angle = rng.uniform(0, 2 * np.pi, number)
        x, y = distance * np.cos(angle), distance * np.sin(angle)
        cluster = np.sin(x * 0.8 + phase[0]) * np.cos(y * 0.7 + phase[1])
        kept = cluster + rng.normal(0, 0.45, number) > threshold
        x, y = x[kept], y[kept]
        meshes = prototypes.undergrowth[kind]
        which = rng.integers(len(meshes), size=len(x))
        foot = np.stack([x, y, terrain.height_m(x, y)], -1)
        turn = rng.uniform(0, 2 * np.pi, len(x))
        size, tint = rng.uniform(*scale, len(x)), rng.uniform(0.75, 1.15, len(x))
        for index, mesh in enumerate(meshes):
            chosen = which == index
            if chosen.any():
                assembly.add(mesh, foot[chosen], turn[chosen], size[chosen], tint[chosen])


def build_scene(settings: SimulatorSettings, prototypes: Prototypes, seed: int) -> Scene:
    """Grow the forest of one seed: ground, stand, undergrowth and light."""
    rng = np.random.default_rng([seed, 1])
    terrain = make_terrain(rng, settings.stand)
    assembly = _Assembly()
    assembly.place(terrain.mesh(), np.zeros(3))
    trees = _grow_stand(rng, assembly, prototypes, settings, terrain)
    _scatter(rng, assembly, prototypes, rng.uniform(*settings.stand.undergrowth), terrain)
    return assembly.scene(trees, terrain, make_light(rng, settings.light), seed)
