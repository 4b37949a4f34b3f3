"""One simulated frame in memory, and the records of the scene and the pose it was drawn from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from perceptree.simulator.labelling.labels import TreeLabel
    from perceptree.simulator.rendering.view import View


@dataclass(frozen=True)
class SceneRecord:
    """What a scene is like: its seed, ground cover, stand, weather and light."""

    seed: int
    terrain: str
    slope_deg: float
    stems_per_ha: float
    pattern: str
    weather: str
    weather_strength: float
    light: str
    overcast: bool


@dataclass(frozen=True)
class PoseRecord:
    """How the camera was held: by a mast or a hand, above the ground, pitch up, roll clockwise."""

    carrier: str
    height_m: float
    pitch_deg: float
    roll_deg: float


@dataclass(frozen=True)
class Motion:
    """Where a frame of a drive was taken: seconds from the first frame on, the camera's
    ``origin_m`` (3,) and ``rotation`` (3, 3), rows right, down, forward, in the world; ``imu``
    (n, 7) time, turn rates in rad/s and acceleration in m/s² since the frame before."""

    time_s: float
    origin_m: NDArray[np.floating[Any]]
    rotation: NDArray[np.floating[Any]]
    imu: NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Frame:
    """One simulated frame with its labels.

    ``image`` (H, W, 3) uint8 BGR; ``depth_m`` (H, W) as the sensor ``depth_sensor`` measures it
    along the optical axis, 0 where there is nothing; ``exact_depth_m`` as drawn, of the pixels
    (i ``exact_stride_px``, j ``exact_stride_px``); ``realism`` what it holds of the settings
    beyond the paper's, by name; ``motion`` where a frame of a drive was taken.
    """

    image: NDArray[np.uint8]
    depth_m: NDArray[np.float32]
    exact_depth_m: NDArray[np.float32]
    labels: list[TreeLabel]
    view: View
    scene: SceneRecord
    pose: PoseRecord
    depth_sensor: dict[str, Any]
    exact_stride_px: int = 1
    realism: dict[str, float | bool] = field(default_factory=dict)
    motion: Motion | None = None
