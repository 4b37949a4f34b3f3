"""What a simulated dataset varies: one frozen dataclass per concern, saved beside the frames."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from perceptree.errors import SettingsError

Range = tuple[float, float]


def _check_range(name: str, value: Range, lowest: float, highest: float) -> None:
    low, high = value
    if not lowest <= low <= high <= highest:
        raise SettingsError(
            f"{name} is {value}: expected low <= high, both in [{lowest:g}, {highest:g}]"
        )


@dataclass(frozen=True)
class CameraSettings:
    """Camera and how it is carried: each frame draws its pose from these ranges."""

    width: int = 1280
    height: int = 720
    horizontal_fov_deg: float = 85.0
    height_m: Range = (1.4, 2.6)
    pitch_deg: Range = (-14.0, 2.0)
    roll_deg: Range = (-4.0, 4.0)

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self, name)
            if value < 64 or value % 2:
                raise SettingsError(f"camera {name} is {value}: expected an even number >= 64")
        if not 20 <= self.horizontal_fov_deg <= 130:
            raise SettingsError(
                f"horizontal_fov_deg is {self.horizontal_fov_deg}: expected 20 to 130"
            )
        _check_range("height_m", self.height_m, 0.3, 10.0)
        _check_range("pitch_deg", self.pitch_deg, -60.0, 30.0)
        _check_range("roll_deg", self.roll_deg, -30.0, 30.0)

    @property
    def focal_px(self) -> float:
        """Focal length of both axes, pixels (square pixels, principal point centred)."""
        return 0.5 * self.width / math.tan(math.radians(self.horizontal_fov_deg) / 2)


@dataclass(frozen=True)
class StandSettings:
    """The forest: density, sizes and how straight its stems are."""

    stems_per_ha: Range = (350.0, 900.0)
    fir_share: Range = (0.3, 1.0)
    diameter_m: Range = (0.06, 0.60)
    diameter_median_m: float = 0.22
    diameter_log_std: float = 0.42
    spacing_m: float = 1.1
    lean_std_deg: float = 3.0
    lean_max_deg: float = 20.0
    slope_deg: Range = (0.0, 12.0)
    relief_m: Range = (0.15, 0.6)
    undergrowth: Range = (0.3, 1.0)

    def __post_init__(self) -> None:
        _check_range("stems_per_ha", self.stems_per_ha, 10.0, 5000.0)
        _check_range("fir_share", self.fir_share, 0.0, 1.0)
        _check_range("diameter_m", self.diameter_m, 0.03, 2.0)
        _check_range("slope_deg", self.slope_deg, 0.0, 30.0)
        _check_range("relief_m", self.relief_m, 0.0, 2.0)
        _check_range("undergrowth", self.undergrowth, 0.0, 1.0)


@dataclass(frozen=True)
class LightSettings:
    """Daylight: where the sun stands and how strong it is against the sky."""

    sun_elevation_deg: Range = (25.0, 65.0)
    sun_strength: Range = (2.5, 7.5)
    haze_per_m: Range = (0.002, 0.008)

    def __post_init__(self) -> None:
        _check_range("sun_elevation_deg", self.sun_elevation_deg, 2.0, 90.0)
        _check_range("sun_strength", self.sun_strength, 0.0, 20.0)
        _check_range("haze_per_m", self.haze_per_m, 0.0, 0.2)


@dataclass(frozen=True)
class SensorSettings:
    """What the sensors make of the scene. Depth noise is that of a stereo camera, growing with z².

    ``depth_noise_per_m`` is the standard deviation in metres at 1 m (at z metres: times z²).
    """

    exposure: Range = (0.5, 0.8)
    noise: Range = (0.01, 0.04)
    depth_noise_per_m: Range = (0.0005, 0.0025)
    depth_range_m: float = 25.0

    def __post_init__(self) -> None:
        _check_range("exposure", self.exposure, 0.05, 5.0)
        _check_range("noise", self.noise, 0.0, 0.5)
        _check_range("depth_noise_per_m", self.depth_noise_per_m, 0.0, 0.05)
        if not 1.0 <= self.depth_range_m <= 65.0:
            raise SettingsError(f"depth_range_m is {self.depth_range_m}: expected 1 to 65")


@dataclass(frozen=True)
class LabelSettings:
    """Which trees are labelled and where their five keypoints lie.

    Heights are metres above the ground on the uphill side of the stem, ``stem_height_m`` above
    the ground at its axis. The axis keypoints lie at half and at a quarter of the labelled stem.
    """

    reach_m: float = 10.0
    stem_height_m: float = 4.0
    cut_height_m: float = 0.20
    diameter_height_m: float = 0.30
    min_visible_fraction: float = 0.08
    min_visible_area: float = 2e-4

    def __post_init__(self) -> None:
        if not 0 < self.cut_height_m < self.diameter_height_m < self.stem_height_m / 4:
            raise SettingsError(
                "label heights must rise: 0 < cut_height_m < diameter_height_m < stem_height_m / 4,"
                f" got {self.cut_height_m}, {self.diameter_height_m}, {self.stem_height_m}"
            )
        if not 1.0 <= self.reach_m <= 40.0:
            raise SettingsError(f"reach_m is {self.reach_m}: expected 1 to 40")


@dataclass(frozen=True)
class SimulatorSettings:
    """Everything that, with a seed, decides every pixel of a dataset."""

    camera: CameraSettings = field(default_factory=CameraSettings)
    stand: StandSettings = field(default_factory=StandSettings)
    light: LightSettings = field(default_factory=LightSettings)
    sensor: SensorSettings = field(default_factory=SensorSettings)
    labels: LabelSettings = field(default_factory=LabelSettings)
    views_per_scene: int = 5

    def __post_init__(self) -> None:
        if self.views_per_scene < 1:
            raise SettingsError(f"views_per_scene is {self.views_per_scene}: expected at least 1")

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready copy."""
        return dataclasses.asdict(self)
