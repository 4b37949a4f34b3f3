"""Scene description: terrain, trees, undergrowth, objects, weather and light.

It is independent of meshes and of the renderer.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from basetree.arrays import Bool, Float
from perceptree.simulator.scene.appearance import Appearance, random_appearance
from perceptree.simulator.scene.circuit import Circuit, make_circuit
from perceptree.simulator.scene.clutter import cover_ground, surround_feet
from perceptree.simulator.scene.conditions import (
    Light,
    Weather,
    infrared_light,
    make_light,
    make_weather,
)
from perceptree.simulator.scene.felling_cut import DIAMETER_ABOVE_CUT_M, cut_height_m, is_near_foot
from perceptree.simulator.scene.models import MODELS, TreeModel
from perceptree.simulator.scene.objects import place_objects
from perceptree.simulator.scene.scatter import Placement, scatter, scatter_roots
from perceptree.simulator.scene.stand import stem_positions
from perceptree.simulator.scene.stem import Stem, random_stem
from perceptree.simulator.scene.terrain import Terrain, make_terrain
from perceptree.simulator.scene.vegetation import Vegetation, grow_vegetation
from perceptree.simulator.settings import (
    GROUNDS,
    PATTERNS,
    SPECIES,
    LabelSettings,
    SimulatorSettings,
    StandSettings,
)
from perceptree.simulator.streams import Stream, choose, stream

NEAR_M = 18.0  # trees within this distance of the centre have full detail
_OBSTACLES_M = {"rock": (0.22, 0.17), "stump": (0.18, 0.33)}  # typical radius and height
_LEAFLESS_SNOW = 0.25  # broadleaved trees have no leaves with this much snow
_DEEP_SNOW = 0.7  # least amount of snow on everything where snow has a depth
_BROKEN_ABOVE_LABELS_M = (0.3, 5.0)  # height of breaks above the labelled stem
_BROKEN_SHARE = 0.8  # stems are not broken above this fraction of their height
_STEM_GAP_M = 0.3  # minimum distance of a stem from a large object


@dataclass(frozen=True)
class Tree:
    """One tree.

    The foot is the point where the stem's axis meets the ground.

    Attributes:
        stem: Shape of the stem.
        position_m: (3,) the foot in the world, m.
        uphill_m: Height of the ground on the uphill side of the stem above the foot, m.
        cut_height_m: Height of the felling cut above the ground on the uphill side, m.
        diameter_height_m: Height of the diameter keypoints above the ground on the uphill side, m.
        top_z_m: Height of the labelled stem's top above the foot, m.
        near: Whether the tree has full detail and can be labelled.
        crown: Chooses the variant of the crown, 0 to 1.
        turn_rad: Rotation of the crown about the vertical.
        tint: Brightness factor.
        dead: Whether the tree is dead, without crown.
    """

    stem: Stem
    position_m: Float
    uphill_m: float
    cut_height_m: float
    diameter_height_m: float
    top_z_m: float
    near: bool
    crown: float
    turn_rad: float
    tint: float
    dead: bool = False

    @property
    def cut_z_m(self) -> float:
        """Height of the felling cut above the foot, m."""
        return self.uphill_m + self.cut_height_m

    @property
    def diameter_z_m(self) -> float:
        """Height of the diameter keypoints above the foot, m."""
        return self.uphill_m + self.diameter_height_m

    @property
    def label_heights_m(self) -> tuple[float, float, float]:
        """Heights of cut, diameter keypoints and labelled stem's top above the foot, m."""
        return self.cut_z_m, self.diameter_z_m, self.top_z_m

    def point(self, height_m: float) -> Float:
        """(3,) point of the axis in the world at a height above the foot, m."""
        return np.asarray(self.position_m + self.stem.axis(np.array(height_m)))

    def ring(self, height_m: float, sides: int = 96) -> Float:
        """(sides, 3) points of the bark in the world around a height above the foot, m."""
        return np.asarray(self.position_m + self.stem.rings(np.array([height_m]), sides)[0, :-1])


@dataclass(frozen=True)
class Scene:
    """Everything in one scene. World axes are x east, y north and z up, in metres.

    Attributes:
        seed: Seed of the scene.
        terrain: The ground.
        stems_per_ha: Density of the stand.
        pattern: Spatial pattern of the stand, one of PATTERNS.
        trees: All trees, near ones first; near tree n (from 0) has the number n + 1 in label
            images.
        undergrowth: Undergrowth and objects.
        leaves: Whether broadleaved trees have leaves.
        weather: The weather.
        light: The light.
        obstacles: (n, 3) circles that cameras avoid: x, y and radius, m.
        dead_twigs: Dead twigs per near conifer, in hundreds, as in ClutterSettings.
        backdrop: Density of the forest beyond the stand, as in ClutterSettings.
        appearance: Colours and textures of the materials.
        fine_crowns: Whether near crowns have fine twigs, as in StandSettings.
        vegetation: Dense grass, hedges and deep snow.
        circuit: Path of the machine in a drive, else None.
    """

    seed: int
    terrain: Terrain
    stems_per_ha: float
    pattern: str
    trees: list[Tree]
    undergrowth: list[Placement]
    leaves: bool
    weather: Weather
    light: Light
    obstacles: Float
    dead_twigs: float
    backdrop: float
    appearance: Appearance
    fine_crowns: bool
    vegetation: Vegetation
    circuit: Circuit | None = None

    @property
    def near_trees(self) -> list[Tree]:
        """The trees that can be labelled, in the order of their numbers in label images."""
        return [tree for tree in self.trees if tree.near]


def describe_scene(settings: SimulatorSettings, seed: int) -> Scene:
    """Draw a random scene.

    Args:
        settings: Ranges of everything in the scene.
        seed: Seed of the scene; the same seed and settings give the same scene.
    """
    rng = stream(seed, Stream.SCENE)
    stand = settings.stand
    terrain = make_terrain(rng, settings.terrain)
    pattern = choose(rng, stand.patterns, PATTERNS)
    stems_per_ha = float(rng.uniform(*stand.stems_per_ha))
    feet = stem_positions(rng, stand, terrain, stems_per_ha, pattern)
    circuit = make_circuit(stream(seed, Stream.CIRCUIT)) if settings.drive.rate_hz else None
    path_m = np.empty((0, 2)) if circuit is None else circuit.points_m[::16]
    if circuit is not None:
        feet = feet[circuit.distance_m(feet) > settings.drive.clearance_m]
    additions_rng = stream(seed, Stream.ADDITIONS)
    objects = settings.objects
    large = place_objects(additions_rng, objects, terrain, path_m, np.empty((0, 3)), large=True)
    feet = feet[_outside_circles(feet, large.circles)]
    feet = feet[np.argsort(np.hypot(*feet.T), kind="stable")]
    trees = _make_trees(rng, settings, terrain, feet)
    if stand.dead_share:
        trees = _with_dead_trees(stream(seed, Stream.DEATH), trees, stand.dead_share)
    undergrowth = scatter(rng, settings.undergrowth, terrain, feet)
    near = feet[np.hypot(*feet.T) < NEAR_M]
    rooted = rng.random(len(near)) < terrain.cover[GROUNDS.index("roots")]
    undergrowth.append(scatter_roots(rng, terrain, near[rooted]))
    weather = make_weather(rng, settings.weather)
    light = make_light(rng, settings.light, weather)
    night_rng = stream(seed, Stream.NIGHT)
    if night_rng.random() < settings.trap.infrared_share:
        light = infrared_light(night_rng, light, weather)
    clutter = settings.clutter
    undergrowth += cover_ground(additions_rng, clutter, terrain)
    radii_m = np.array([tree.stem.diameter_m / 2 for tree in trees if tree.near])
    undergrowth += surround_feet(additions_rng, clutter, terrain, near, radii_m)
    taken_m = np.concatenate([feet, path_m])
    small = place_objects(additions_rng, objects, terrain, taken_m, large.circles, large=False)
    stems_m = np.column_stack([near, radii_m])
    vegetation = grow_vegetation(seed, settings.vegetation, terrain, weather, stems_m, path_m)
    if vegetation.snow_m is not None:
        weather = replace(weather, snow=max(weather.snow, _DEEP_SNOW))
    if settings.labels.cut_rule == "visible":
        trees = [_with_visible_cut(tree, undergrowth) for tree in trees]
    return Scene(
        seed,
        terrain,
        stems_per_ha,
        pattern,
        trees,
        undergrowth + large.placements + small.placements,
        weather.snow < _LEAFLESS_SNOW,
        weather,
        light,
        small.circles,
        float(additions_rng.uniform(*clutter.dead_twigs)),
        float(additions_rng.uniform(*clutter.backdrop)),
        random_appearance(additions_rng, settings.randomisation),
        stand.fine_crowns,
        vegetation,
        circuit,
    )


def _outside_circles(places_m: Float, circles: Float) -> Bool:
    """(n,) whether points (n, 2) are outside all circles (m, 3) of x, y and radius."""
    inside = np.zeros(len(places_m), np.bool_)
    for x, y, radius in circles:
        inside |= np.hypot(places_m[:, 0] - x, places_m[:, 1] - y) < radius + _STEM_GAP_M
    return ~inside


def _with_visible_cut(tree: Tree, undergrowth: list[Placement]) -> Tree:
    """Set the cut of a near tree by the rule in `felling_cut`."""
    if not tree.near:
        return tree
    heights_m: list[float] = []
    for placement in undergrowth:
        size = _OBSTACLES_M.get(placement.kind)
        if size is not None and len(placement.position_m):
            width_m, height_m = np.multiply.outer(size, placement.scale)
            positions = placement.position_m
            near = is_near_foot(
                tree.position_m[:2], tree.stem.diameter_m / 2, positions[:, :2], width_m
            )
            tops = positions[near, 2] + height_m[near] - tree.position_m[2] - tree.uphill_m
            heights_m += tops.tolist()
    cut_m = cut_height_m(tree.stem, tree.uphill_m, heights_m)
    return replace(tree, cut_height_m=cut_m, diameter_height_m=cut_m + DIAMETER_ABOVE_CUT_M)


def _make_trees(
    rng: np.random.Generator, settings: SimulatorSettings, terrain: Terrain, feet: Float
) -> list[Tree]:
    stand = settings.stand
    models, shares = _species_mix(rng, stand)
    median_m, lean_std_deg = rng.uniform(*stand.diameter_median_m), rng.uniform(*stand.lean_std_deg)
    trees = []
    for x, y in feet:
        model = models[rng.choice(len(models), p=shares)]
        diameter_m = _diameter_m(rng, stand, median_m)
        stem = random_stem(
            rng, model, diameter_m, lean_std_deg, stand.lean_max_deg, stand.fork_share
        )
        trees.append(_place_tree(rng, stem, float(x), float(y), terrain, settings.labels))
    return trees


def _with_dead_trees(rng: np.random.Generator, trees: list[Tree], share: float) -> list[Tree]:
    """Make a fraction of the trees dead; half of these are broken above the labelled stem."""
    result = []
    for tree in trees:
        dies, breaks, height_m = (
            rng.random() < share,
            rng.random() < 0.5,
            rng.uniform(*_BROKEN_ABOVE_LABELS_M),
        )
        stem = tree.stem
        broken_m = float(tree.top_z_m + height_m)
        if dies and breaks and stem.fork is None and broken_m < _BROKEN_SHARE * stem.height_m:
            stem = replace(stem, broken_m=broken_m)
        result.append(replace(tree, stem=stem, dead=True) if dies else tree)
    return result


def _species_mix(rng: np.random.Generator, stand: StandSettings) -> tuple[list[TreeModel], Float]:
    """Choose a few species for a scene: their models, and the fraction of each model."""
    weights = np.array([stand.species.get(name, 0.0) for name in SPECIES])
    count = min(stand.species_per_scene, int((weights > 0).sum()))
    chosen = rng.choice(len(SPECIES), count, replace=False, p=weights / weights.sum())
    part = dict(zip(chosen.tolist(), rng.dirichlet(np.full(count, 1.2)), strict=True))
    models = [model for model in MODELS if SPECIES.index(model.species) in part]
    shares = np.array([part[SPECIES.index(model.species)] for model in models])
    shares = shares * rng.uniform(0.2, 1.0, len(models))
    return models, shares / shares.sum()


def _diameter_m(rng: np.random.Generator, stand: StandSettings, median_m: float) -> float:
    """Draw a log-normal diameter until it is within the stand's bounds."""
    for _ in range(30):
        diameter_m = float(median_m * np.exp(rng.normal(0, stand.diameter_log_std)))
        if stand.diameter_m[0] <= diameter_m <= stand.diameter_m[1]:
            return diameter_m
    return float(np.clip(diameter_m, *stand.diameter_m))


def _place_tree(
    rng: np.random.Generator,
    stem: Stem,
    x: float,
    y: float,
    terrain: Terrain,
    labels: LabelSettings,
) -> Tree:
    """Place a stem on the ground, and its labels above the ground on the uphill side."""
    foot = np.array([x, y, float(terrain.height_m(x, y))])
    radius = 0.6 * stem.diameter_m
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    around = terrain.height_m(x + radius * np.cos(angle), y + radius * np.sin(angle))
    return Tree(
        stem,
        foot,
        max(0.0, float(around.max()) - float(foot[2])),
        labels.cut_height_m,
        labels.diameter_height_m,
        labels.stem_height_m,
        bool(np.hypot(x, y) < NEAR_M),
        float(rng.random()),
        float(rng.uniform(0, 2 * np.pi)),
        float(rng.uniform(0.75, 1.15)),
    )
