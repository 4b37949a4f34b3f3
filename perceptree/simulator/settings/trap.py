"""Settings of pictures as camera traps take them. Off by default."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import Range, check_number, check_range


@dataclass(frozen=True)
class TrapSettings:
    """Infrared nights and captions. Each infrared frame draws from the ranges.

    Stems, views, labels and depth do not depend on it.

    Attributes:
        infrared_share: Fraction of the scenes that are nights with an infrared lamp at the lens,
            whatever their time of day would be.
        reach_m: Distance at which the camera is set to show a surface lit head-on in middle grey,
            m. Half of the exposure, in stops, follows the mean of the picture instead.
        beam: Width of the lamp's beam, as a fraction of the picture's width.
        blur_px: Standard deviation of the blur, px.
        grain: Standard deviation of the grain, as a fraction of full scale.
        floor: Brightness of black, as a fraction of full scale.
        tint_share: Fraction of the infrared frames with a tint of purple or green.
        caption_share: Fraction of all frames with a caption of date, temperature and logo.

    Raises:
        SettingsError: If a value is out of range.
    """

    infrared_share: float = 0.0
    reach_m: Range = (1.8, 5.0)
    beam: Range = (0.45, 1.2)
    blur_px: Range = (0.2, 1.1)
    grain: Range = (0.004, 0.02)
    floor: Range = (0.0, 0.09)
    tint_share: float = 0.15
    caption_share: float = 0.0

    def __post_init__(self) -> None:
        for name in ("infrared_share", "tint_share", "caption_share"):
            check_number(name, getattr(self, name), 0.0, 1.0)
        check_range("reach_m", self.reach_m, 0.5, 40.0)
        check_range("beam", self.beam, 0.1, 10.0)
        check_range("blur_px", self.blur_px, 0.0, 5.0)
        check_range("grain", self.grain, 0.0, 0.5)
        check_range("floor", self.floor, 0.0, 0.5)
