"""A simulated frame in memory, with a record of its scene."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from basetree.arrays import Float, Float32, UInt8

if TYPE_CHECKING:
    from perceptree.simulator.labelling.labels import TreeLabel
    from perceptree.simulator.rendering.view import View


@dataclass(frozen=True)
class SceneRecord:
    """Properties of a scene, as stored in the dataset.

    Attributes:
        seed: Seed of the scene.
        terrain: Main ground cover.
        slope_deg: Mean slope.
        stems_per_ha: Density of the stand.
        pattern: Spatial pattern of the stand.
        weather: Kind of weather.
        weather_strength: Strength of the weather, 0 to 1.
        light: Time of day.
        overcast: Whether the sky is overcast.
    """

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
class Motion:
    """Camera motion at a frame of a drive.

    Attributes:
        time_s: Time since the first frame, s.
        origin_m: (3,) camera position in the world, m.
        rotation: (3, 3) camera axes in the world; the rows are right, down and forward.
        imu: (n, 7) IMU samples since the previous frame: time (s), turn rates (rad/s) and
            specific force (m/s²).
    """

    time_s: float
    origin_m: Float
    rotation: Float
    imu: Float


@dataclass(frozen=True)
class LabelledFrame:
    """One simulated frame with its labels.

    Attributes:
        image: (H, W, 3) uint8 BGR.
        depth_m: (H, W) measured depth along the optical axis, m; 0 where there is no reading.
        exact_depth_m: Exact depth of every `exact_stride_px`-th pixel and row, m; 0 beyond its
            range.
        labels: The labelled trees.
        view: The camera.
        scene: Properties of the scene.
        depth_sensor: Kind and parameters of the depth sensor.
        exact_stride_px: Stride of `exact_depth_m`, px.
        realism: Additions beyond the paper's conditions in the frame, by name.
        motion: Camera motion at a frame of a drive, else None.
    """

    image: UInt8
    depth_m: Float32
    exact_depth_m: Float32
    labels: list[TreeLabel]
    view: View
    scene: SceneRecord
    depth_sensor: dict[str, Any]
    exact_stride_px: int = 1
    realism: dict[str, float | bool] = field(default_factory=dict)
    motion: Motion | None = None
