"""Settings of the forest: ground, stand and undergrowth."""

from __future__ import annotations

from dataclasses import dataclass, field

from perceptree.simulator.settings.checks import (
    OMIT_DEFAULT,
    Range,
    Shares,
    check_number,
    check_range,
    check_shares,
)

GROUNDS = ("litter", "moss", "roots", "mud")
SPECIES = ("fir", "spruce", "pine", "beech", "birch", "maple")
PATTERNS = ("random", "regular", "clustered")


@dataclass(frozen=True)
class TerrainSettings:
    """The ground.

    Attributes:
        slope_deg: Range of the mean slope of a scene.
        relief_m: Range of the standard deviation of the large-scale relief, m.
        roughness_m: Range of the standard deviation of the small-scale relief, m.
        grounds: Weight of each of GROUNDS to be the main cover of a scene; the others are mixed in
            as patches.

    Raises:
        SettingsError: If a value is out of range.
    """

    slope_deg: Range = (0.0, 30.0)
    relief_m: Range = (0.15, 0.7)
    roughness_m: Range = (0.01, 0.035)
    grounds: Shares = field(
        default_factory=lambda: {"litter": 1.0, "moss": 1.0, "roots": 1.0, "mud": 1.0}
    )

    def __post_init__(self) -> None:
        check_range("slope_deg", self.slope_deg, 0.0, 30.0)
        check_range("relief_m", self.relief_m, 0.0, 2.0)
        check_range("roughness_m", self.roughness_m, 0.0, 0.1)
        check_shares("grounds", self.grounds, GROUNDS)


@dataclass(frozen=True)
class StandSettings:
    """The stand: number, positions and shapes of the trees.

    Attributes:
        stems_per_ha: Range of the density.
        patterns: Weight of each of PATTERNS, the spatial pattern of a scene.
        spacing_m: Minimum distance of two stems, m.
        neighbour_radius_m: Radius in which neighbours are counted, m.
        max_neighbours: Maximum number of other stems within that radius.
        altitude_preference: Range of the preference from -1 (hollows) to 1 (ridges), which thins
            the stand by altitude.
        max_slope_deg: Ground steeper than this has no stems.
        species: Weight of each of SPECIES.
        species_per_scene: Number of species in a scene.
        diameter_m: Minimum and maximum diameter at breast height, m.
        diameter_median_m: Range of the median diameter of a scene, m.
        diameter_log_std: Standard deviation of the logarithm of the diameter.
        lean_std_deg: Range of the standard deviation of the normal distribution whose absolute
            value is the lean.
        lean_max_deg: Maximum lean.
        fork_share: Fraction of forked stems.
        dead_share: Fraction of dead trees, without foliage; some are broken above the labelled
            stem.
        fine_crowns: Whether near crowns have more and smaller twigs that spread more irregularly.

    Raises:
        SettingsError: If a value is out of range.
    """

    stems_per_ha: Range = (300.0, 860.0)
    patterns: Shares = field(
        default_factory=lambda: {"random": 1.0, "regular": 1.0, "clustered": 1.0}
    )
    spacing_m: float = 1.1
    neighbour_radius_m: float = 4.0
    max_neighbours: int = 8
    altitude_preference: Range = (-0.6, 0.6)
    max_slope_deg: float = 42.0
    species: Shares = field(
        default_factory=lambda: {
            "fir": 3.0,
            "spruce": 3.0,
            "pine": 1.5,
            "beech": 2.0,
            "birch": 1.5,
            "maple": 1.0,
        }
    )
    species_per_scene: int = 3
    diameter_m: Range = (0.05, 0.60)
    diameter_median_m: Range = (0.16, 0.28)
    diameter_log_std: float = 0.42
    lean_std_deg: Range = (1.0, 6.0)
    lean_max_deg: float = 20.0
    fork_share: float = 0.06
    dead_share: float = field(default=0.0, metadata=OMIT_DEFAULT)
    fine_crowns: bool = field(default=False, metadata=OMIT_DEFAULT)

    def __post_init__(self) -> None:
        check_range("stems_per_ha", self.stems_per_ha, 10.0, 5000.0)
        check_shares("patterns", self.patterns, PATTERNS)
        check_number("spacing_m", self.spacing_m, 0.3, 10.0)
        check_number("neighbour_radius_m", self.neighbour_radius_m, 0.5, 10.0)
        check_number("max_neighbours", self.max_neighbours, 0, 100)
        check_range("altitude_preference", self.altitude_preference, -1.0, 1.0)
        check_number("max_slope_deg", self.max_slope_deg, 5.0, 90.0)
        check_shares("species", self.species, SPECIES)
        check_number("species_per_scene", self.species_per_scene, 1, len(SPECIES))
        check_range("diameter_m", self.diameter_m, 0.03, 2.0)
        check_range("diameter_median_m", self.diameter_median_m, *self.diameter_m)
        check_number("diameter_log_std", self.diameter_log_std, 0.0, 1.5)
        check_range("lean_std_deg", self.lean_std_deg, 0.0, 20.0)
        check_number("lean_max_deg", self.lean_max_deg, 0.0, 20.0)
        check_number("fork_share", self.fork_share, 0.0, 1.0)
        check_number("dead_share", self.dead_share, 0.0, 1.0)


@dataclass(frozen=True)
class UndergrowthSettings:
    """Density of the undergrowth by kind: ranges from 0 (none) to 1 (dense).

    Attributes:
        grass: Grass tufts.
        ferns: Ferns.
        scrubs: Bushes, seedlings and saplings.
        branches: Fallen branches and logs.
        stumps: Stumps.
        rocks: Rocks.

    Raises:
        SettingsError: If a value is out of range.
    """

    grass: Range = (0.0, 1.0)
    ferns: Range = (0.0, 1.0)
    scrubs: Range = (0.0, 1.0)
    branches: Range = (0.1, 1.0)
    stumps: Range = (0.0, 1.0)
    rocks: Range = (0.0, 1.0)

    def __post_init__(self) -> None:
        for name in ("grass", "ferns", "scrubs", "branches", "stumps", "rocks"):
            check_range(name, getattr(self, name), 0.0, 1.0)
