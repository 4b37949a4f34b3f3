"""Settings of pictures as camera traps take them. Off by default."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings
from perceptree.simulator.settings.checks import Range, number


@dataclass(frozen=True)
class TrapSettings(Settings):
    """Infrared nights and captions. Each infrared frame draws from the ranges.

    Stems, views, labels and depth do not depend on it.
    """

    infrared_share: float = field(default=0.0, metadata=number(0, 1))
    """Fraction of the scenes that are nights with an infrared lamp at the lens, whatever their time
    of day would be."""
    reach_m: Range = field(default=(1.8, 5.0), metadata=number(0.5, 40))
    """Distance at which the camera is set to show a surface lit head-on in middle grey, m. Half of
    the exposure, in stops, follows the mean of the picture instead."""
    beam: Range = field(default=(0.45, 1.2), metadata=number(0.1, 10))
    """Width of the lamp's beam, as a fraction of the picture's width."""
    blur_px: Range = field(default=(0.2, 1.1), metadata=number(0, 5))
    """Standard deviation of the blur, px."""
    grain: Range = field(default=(0.004, 0.02), metadata=number(0, 0.5))
    """Standard deviation of the grain, as a fraction of full scale."""
    floor: Range = field(default=(0.0, 0.09), metadata=number(0, 0.5))
    """Brightness of black, as a fraction of full scale."""
    tint_share: float = field(default=0.15, metadata=number(0, 1))
    """Fraction of the infrared frames with a tint of purple or green."""
    caption_share: float = field(default=0.0, metadata=number(0, 1))
    """Fraction of all frames with a caption of date, temperature and logo."""
