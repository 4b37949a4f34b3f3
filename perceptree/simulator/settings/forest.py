"""Settings of the forest: ground, stand and undergrowth."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings, check_value, weights
from perceptree.simulator.settings.checks import OMIT_DEFAULT, Range, Shares, number

GROUNDS = ("litter", "moss", "roots", "mud")
SPECIES = ("fir", "spruce", "pine", "beech", "birch", "maple")
PATTERNS = ("random", "regular", "clustered")


@dataclass(frozen=True)
class TerrainSettings(Settings):
    """The ground."""

    slope_deg: Range = field(default=(0.0, 30.0), metadata=number(0, 30))
    """Range of the mean slope of a scene."""
    relief_m: Range = field(default=(0.15, 0.7), metadata=number(0, 2))
    """Range of the standard deviation of the large-scale relief, m."""
    roughness_m: Range = field(default=(0.01, 0.035), metadata=number(0, 0.1))
    """Range of the standard deviation of the small-scale relief, m."""
    grounds: Shares = field(
        default_factory=lambda: {"litter": 1.0, "moss": 1.0, "roots": 1.0, "mud": 1.0},
        metadata=weights(GROUNDS),
    )
    """Weight of each of GROUNDS to be the main cover of a scene; the others are mixed in as
    patches."""


@dataclass(frozen=True)
class StandSettings(Settings):
    """The stand: number, positions and shapes of the trees."""

    stems_per_ha: Range = field(default=(300.0, 860.0), metadata=number(10, 5000))
    """Range of the density."""
    patterns: Shares = field(
        default_factory=lambda: {"random": 1.0, "regular": 1.0, "clustered": 1.0},
        metadata=weights(PATTERNS),
    )
    """Weight of each of PATTERNS, the spatial pattern of a scene."""
    spacing_m: float = field(default=1.1, metadata=number(0.3, 10))
    """Minimum distance of two stems, m."""
    neighbour_radius_m: float = field(default=4.0, metadata=number(0.5, 10))
    """Radius in which neighbours are counted, m."""
    max_neighbours: int = field(default=8, metadata=number(0, 100))
    """Maximum number of other stems within that radius."""
    altitude_preference: Range = field(default=(-0.6, 0.6), metadata=number(-1, 1))
    """Range of the preference from -1 (hollows) to 1 (ridges), which thins the stand by
    altitude."""
    max_slope_deg: float = field(default=42.0, metadata=number(5, 90))
    """Ground steeper than this has no stems."""
    species: Shares = field(
        default_factory=lambda: {
            "fir": 3.0,
            "spruce": 3.0,
            "pine": 1.5,
            "beech": 2.0,
            "birch": 1.5,
            "maple": 1.0,
        },
        metadata=weights(SPECIES),
    )
    """Weight of each of SPECIES."""
    species_per_scene: int = field(default=3, metadata=number(1, len(SPECIES)))
    """Number of species in a scene."""
    diameter_m: Range = field(default=(0.05, 0.60), metadata=number(0.03, 2))
    """Minimum and maximum diameter at breast height, m."""
    diameter_median_m: Range = (0.16, 0.28)
    """Range of the median diameter of a scene, m."""
    diameter_log_std: float = field(default=0.42, metadata=number(0, 1.5))
    """Standard deviation of the logarithm of the diameter."""
    lean_std_deg: Range = field(default=(1.0, 6.0), metadata=number(0, 20))
    """Range of the standard deviation of the normal distribution whose absolute value is the
    lean."""
    lean_max_deg: float = field(default=20.0, metadata=number(0, 20))
    """Maximum lean."""
    fork_share: float = field(default=0.06, metadata=number(0, 1))
    """Fraction of forked stems."""
    dead_share: float = field(default=0.0, metadata=number(0, 1) | OMIT_DEFAULT)
    """Fraction of dead trees, without foliage; some are broken above the labelled stem."""
    fine_crowns: bool = field(default=False, metadata=OMIT_DEFAULT)
    """Whether near crowns have more and smaller twigs that spread more irregularly."""

    def _check_together(self) -> None:
        check_value("diameter_median_m", self.diameter_median_m, number(*self.diameter_m))


@dataclass(frozen=True)
class UndergrowthSettings(Settings, each=number(0, 1)):
    """Density of the undergrowth by kind: ranges from 0 (none) to 1 (dense)."""

    grass: Range = (0.0, 1.0)
    """Grass tufts."""
    ferns: Range = (0.0, 1.0)
    """Ferns."""
    scrubs: Range = (0.0, 1.0)
    """Bushes, seedlings and saplings."""
    branches: Range = (0.1, 1.0)
    """Fallen branches and logs."""
    stumps: Range = (0.0, 1.0)
    """Stumps."""
    rocks: Range = (0.0, 1.0)
    """Rocks."""
