"""One camera and one depth sensor for all frames of a drive."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from perceptree.simulator.settings import DEPTH_KINDS, SimulatorSettings

_OF_COLOUR = ("exposure", "noise", "blur_px", "white_balance")
_OF_DEPTH = (
    "baseline_m",
    "disparity_noise_px",
    "stereo_range_m",
    "tof_noise_per_m",
    "tof_range_m",
    "holes",
)


def fixed_sensors(rng: np.random.Generator, settings: SimulatorSettings) -> SimulatorSettings:
    """Settings in which what each frame draws of its sensors is drawn already."""
    depth = settings.depth
    shares = np.array([depth.kinds.get(kind, 0.0) for kind in DEPTH_KINDS])
    kind = DEPTH_KINDS[rng.choice(len(DEPTH_KINDS), p=shares / shares.sum())]
    return replace(
        settings,
        rgb=replace(settings.rgb, **_drawn(rng, settings.rgb, _OF_COLOUR)),
        depth=replace(depth, kinds={kind: 1.0}, **_drawn(rng, depth, _OF_DEPTH)),
    )


def _drawn(rng: np.random.Generator, settings: Any, names: tuple[str, ...]) -> dict[str, Any]:
    """Ranges of no width, at a value drawn from the settings' ranges."""
    return {name: (float(rng.uniform(*getattr(settings, name))),) * 2 for name in names}
