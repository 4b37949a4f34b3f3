"""Settings of a drive: a machine's path through one scene, filmed at a frame rate."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import Range, check_number, check_range


@dataclass(frozen=True)
class DriveSettings:
    """A machine that drives around a closed path. The views of a scene are the frames.

    Attributes:
        rate_hz: Frame rate; 0 for independent views instead of a drive.
        speed_m_per_s: Range of the speed, m/s.
        stops_per_minute: Mean number of stops per minute.
        clearance_m: Stems closer to the path are left out, m.
        sway_deg: Range of the amplitude of pitch and roll.
        slew_deg: Range of the largest angle by which the crane, which carries the camera, slews to
            either side.

    Raises:
        SettingsError: If a value is out of range.
    """

    rate_hz: float = 0.0
    speed_m_per_s: Range = (0.4, 1.5)
    stops_per_minute: float = 3.0
    clearance_m: float = 1.3
    sway_deg: Range = (0.3, 1.5)
    slew_deg: Range = (0.0, 50.0)

    def __post_init__(self) -> None:
        check_number("rate_hz", self.rate_hz, 0.0, 120.0)
        check_range("speed_m_per_s", self.speed_m_per_s, 0.05, 5.0)
        check_number("stops_per_minute", self.stops_per_minute, 0.0, 30.0)
        check_number("clearance_m", self.clearance_m, 0.5, 5.0)
        check_range("sway_deg", self.sway_deg, 0.0, 5.0)
        check_range("slew_deg", self.slew_deg, 0.0, 170.0)
