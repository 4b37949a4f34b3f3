"""Fixed sensor parameters for all frames of a drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from perceptree.simulator.settings import DEPTH_KINDS, SimulatorSettings
from perceptree.simulator.streams import choose

_RGB_RANGES = ("exposure", "noise", "blur_px", "white_balance")
_DEPTH_RANGES = (
    "baseline_m",
    "disparity_noise_px",
    "stereo_range_m",
    "tof_noise_per_m",
    "tof_range_m",
    "holes",
)


def fixed_sensors(rng: np.random.Generator, settings: SimulatorSettings) -> SimulatorSettings:
    """Draw the sensor parameters once and return settings in which they no longer vary."""
    depth = settings.depth
    kind = choose(rng, depth.kinds, DEPTH_KINDS)
    return replace(
        settings,
        rgb=replace(settings.rgb, **_drawn(rng, settings.rgb, _RGB_RANGES)),
        depth=replace(depth, kinds={kind: 1.0}, **_drawn(rng, depth, _DEPTH_RANGES)),
    )


def _drawn(rng: np.random.Generator, settings: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Draw a value from each range, as a range from that value to itself."""
    return {name: (float(rng.uniform(*getattr(settings, name))),) * 2 for name in names}
