"""Settings of a drive: a machine's path through one scene, filmed at a frame rate."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings
from perceptree.simulator.settings.checks import Range, number


@dataclass(frozen=True)
class DriveSettings(Settings):
    """A machine that drives around a closed path. The views of a scene are the frames."""

    rate_hz: float = field(default=0.0, metadata=number(0, 120))
    """Frame rate; 0 for independent views instead of a drive."""
    speed_m_per_s: Range = field(default=(0.4, 1.5), metadata=number(0.05, 5))
    """Range of the speed, m/s."""
    stops_per_minute: float = field(default=3.0, metadata=number(0, 30))
    """Mean number of stops per minute."""
    clearance_m: float = field(default=1.3, metadata=number(0.5, 5))
    """Stems closer to the path are left out, m."""
    sway_deg: Range = field(default=(0.3, 1.5), metadata=number(0, 5))
    """Range of the amplitude of pitch and roll."""
    slew_deg: Range = field(default=(0.0, 50.0), metadata=number(0, 170))
    """Range of the largest angle by which the crane, which carries the camera, slews to either
    side."""
