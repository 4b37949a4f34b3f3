"""Settings of a drive: a machine's way through one scene, filmed at a frame rate."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import Range, check_number, check_range


@dataclass(frozen=True)
class DriveSettings:
    """How a machine drives around a closed circuit in a scene; a scene's views are its frames.

    ``rate_hz`` is the frame rate, 0 for single views instead of a drive. The machine moves at a
    speed drawn from ``speed_m_per_s`` and halts ``stops_per_minute`` times a minute; stems closer
    to its way than ``clearance_m`` were felled before. It sways by ``sway_deg`` (standard
    deviation of pitch and roll) and its crane, which carries the camera, slews by up to
    ``slew_deg`` to either side.
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
