"""Settings of cover that hides the ground: dense grass, hedges and deep snow. Off by default."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import Range, check_number, check_range


@dataclass(frozen=True)
class VegetationSettings:
    """Cover that hides the ground and the feet of stems. Each scene draws from these ranges.

    Labels do not depend on it: heights are above the soil, and whatever hides a stem lowers its
    visible fraction.

    Attributes:
        grass_share: Fraction of the scenes with dense grass. Scenes with deep snow have none.
        grass_cover: Fraction of the ground's area that grass stands on; the rest shows the soil.
        grass_height_m: Mean height of a scene's grass, m. Tufts differ by up to 25 %.
        hedge_share: Fraction of the scenes with hedges.
        hedges: Number of hedges in such a scene, rounded.
        hedge_height_m: Height of a hedge, m.
        snow_depth_m: Mean depth of the snow in scenes with the weather ``snow`` or ``snowfall``,
            m. Snow is a surface above the soil; at (0, 0) it is only a colour.

    Raises:
        SettingsError: If a value is out of range.
    """

    grass_share: float = 0.0
    grass_cover: Range = (0.5, 0.95)
    grass_height_m: Range = (0.1, 0.5)
    hedge_share: float = 0.0
    hedges: Range = (1.0, 3.0)
    hedge_height_m: Range = (0.6, 2.0)
    snow_depth_m: Range = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_number("grass_share", self.grass_share, 0.0, 1.0)
        check_range("grass_cover", self.grass_cover, 0.0, 1.0)
        check_range("grass_height_m", self.grass_height_m, 0.05, 0.8)
        check_number("hedge_share", self.hedge_share, 0.0, 1.0)
        check_range("hedges", self.hedges, 0.0, 10.0)
        check_range("hedge_height_m", self.hedge_height_m, 0.4, 3.0)
        check_range("snow_depth_m", self.snow_depth_m, 0.0, 0.6)
