"""Settings of cover that hides the ground: dense grass, hedges and deep snow. Off by default."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings
from perceptree.simulator.settings.checks import Range, number


@dataclass(frozen=True)
class VegetationSettings(Settings):
    """Cover that hides the ground and the feet of stems. Each scene draws from these ranges.

    Labels do not depend on it: heights are above the soil, and whatever hides a stem lowers its
    visible fraction.
    """

    grass_share: float = field(default=0.0, metadata=number(0, 1))
    """Fraction of the scenes with dense grass. Scenes with deep snow have none."""
    grass_cover: Range = field(default=(0.5, 0.95), metadata=number(0, 1))
    """Fraction of the ground's area that grass stands on; the rest shows the soil."""
    grass_height_m: Range = field(default=(0.1, 0.5), metadata=number(0.05, 0.8))
    """Mean height of a scene's grass, m. Tufts differ by up to 25 %."""
    hedge_share: float = field(default=0.0, metadata=number(0, 1))
    """Fraction of the scenes with hedges."""
    hedges: Range = field(default=(1.0, 3.0), metadata=number(0, 10))
    """Number of hedges in such a scene, rounded."""
    hedge_height_m: Range = field(default=(0.6, 2.0), metadata=number(0.4, 3))
    """Height of a hedge, m."""
    snow_depth_m: Range = field(default=(0.0, 0.0), metadata=number(0, 0.6))
    """Mean depth of the snow in scenes with the weather `snow` or `snowfall`, m. Snow is a
    surface above the soil; at (0, 0) it is only a colour."""
