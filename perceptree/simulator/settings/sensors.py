"""Settings of the camera, the colour sensor and the depth sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from basetree.errors import SettingsError
from basetree.settings import Settings, label, weights
from calib import PinholeCamera, pixels_to_rays
from perceptree.simulator.settings.checks import OMIT_DEFAULT, Range, Shares, check_number, number

DEPTH_KINDS = ("stereo", "tof")
_FARTHEST_DEG = 83.0  # off the axis: a bent picture is drawn through a pinhole that sees all of it


def ideal_camera(width: int, height: int, horizontal_fov_deg: float = 85.0) -> PinholeCamera:
    """Make a centred camera with square pixels and no distortion, like a rectified ZED image.

    Args:
        width: Image width, px; even and at least 64.
        height: Image height, px; even and at least 64.
        horizontal_fov_deg: Horizontal field of view, 20 to 130 degrees.

    Raises:
        SettingsError: If a value is out of range.
    """
    _check_size(width, height)
    check_number("horizontal_fov_deg", horizontal_fov_deg, 20.0, 130.0)
    focal = 0.5 * width / math.tan(math.radians(horizontal_fov_deg) / 2)
    return PinholeCamera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


def _check_size(width: int, height: int) -> None:
    for name, value in (("width", width), ("height", height)):
        if value < 64 or value % 2:
            raise SettingsError(f"camera {name} is {value}: expected an even number >= 64")


def _check_view(camera: PinholeCamera) -> None:
    width, height = float(camera.width), float(camera.height)
    corners = [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]]
    rays = pixels_to_rays(camera, corners)
    farthest_deg = max(math.degrees(math.atan(math.hypot(x, y))) for x, y, _ in rays)
    if farthest_deg > _FARTHEST_DEG:
        raise SettingsError(
            f"the camera sees {farthest_deg:.0f} degrees or more off its axis in a corner: expected"
            f" at most {_FARTHEST_DEG:g}, as a pinhole draws it; crop the picture to its middle"
        )


@dataclass(frozen=True)
class PoseSettings(Settings):
    """How a camera is carried. Each view draws from these ranges."""

    height_m: Range = field(metadata=number(0.3, 10))
    """Height above the ground, m."""
    pitch_deg: Range = field(metadata=number(-60, 30))
    """Pitch, positive upwards."""
    roll_deg: Range = field(metadata=number(-30, 30))
    """Roll."""


@dataclass(frozen=True)
class CameraSettings(Settings):
    """The camera."""

    intrinsics: PinholeCamera = field(default_factory=lambda: ideal_camera(1280, 720))
    """Intrinsics; width and height are even, and no corner is more than 83 degrees off the axis."""
    mast: PoseSettings = PoseSettings((2.0, 3.4), (-22.0, -2.0), (-5.0, 5.0))
    """How the camera is carried on a machine's mast."""
    hand: PoseSettings = PoseSettings((1.2, 1.9), (-12.0, 6.0), (-6.0, 6.0))
    """How the camera is carried by hand."""
    mast_share: float = field(default=0.5, metadata=number(0, 1))
    """Fraction of the views from a mast."""

    def _check_together(self) -> None:
        _check_size(self.intrinsics.width, self.intrinsics.height)
        _check_view(self.intrinsics)

    @classmethod
    def of_size(cls, width: int, height: int, horizontal_fov_deg: float = 85.0) -> CameraSettings:
        """Make the default camera with another image size, as `ideal_camera`."""
        return cls(ideal_camera(width, height, horizontal_fov_deg))


@dataclass(frozen=True)
class RgbSettings(Settings):
    """The colour sensor. Each frame draws from these ranges."""

    exposure: Range = field(default=(0.45, 0.9), metadata=number(0.05, 5))
    """Exposure of the metered mean; 1 makes it middle grey."""
    noise: Range = field(default=(0.003, 0.012), metadata=number(0, 0.5))
    """Standard deviation of the noise at middle grey by day, as a fraction of full scale."""
    blur_px: Range = field(default=(0.0, 1.0), metadata=number(0, 5))
    """Standard deviation of the lens's Gaussian blur, px."""
    motion_px: Range = field(default=(0.0, 4.0), metadata=number(0, 40))
    """Length of a straight motion blur, px."""
    motion_share: float = field(default=0.2, metadata=number(0, 1))
    """Fraction of frames with motion blur."""
    white_balance: Range = field(default=(-0.12, 0.12), metadata=number(-0.5, 0.5))
    """Error of the red and blue gains."""
    jpeg_quality: int = field(default=85, metadata=number(30, 100))
    """Quality of JPEG files."""
    dusk_exposure: float = field(default=0.55, metadata=number(0.05, 1) | OMIT_DEFAULT)
    """Factor of the exposure at dusk."""


@dataclass(frozen=True)
class DepthSettings(Settings):
    """The depth sensor. Each frame draws a kind, and its parameters from these ranges."""

    kinds: Shares = field(
        default_factory=lambda: {"stereo": 3.0, "tof": 1.0},
        metadata=weights(DEPTH_KINDS) | label("depth kinds"),
    )
    """Weight of each of DEPTH_KINDS."""
    baseline_m: Range = field(default=(0.06, 0.12), metadata=number(0.02, 1))
    """Baseline of the stereo camera, m."""
    disparity_noise_px: Range = field(default=(0.05, 0.2), metadata=number(0, 5))
    """Standard deviation of the disparity, px of the image. The standard deviation of the depth is
    z² / (f b) times that."""
    disparity_step_px: float = field(default=0.0625, metadata=number(0.001, 1))
    """Quantisation of the disparity, px of the image."""
    stereo_range_m: Range = field(default=(15.0, 25.0), metadata=number(1, 65))
    """Maximum depth of the stereo camera, m."""
    tof_noise_per_m: Range = field(default=(0.0003, 0.002), metadata=number(0, 0.05))
    """Standard deviation of a time-of-flight camera's depth over z², 1/m."""
    tof_range_m: Range = field(default=(6.0, 12.0), metadata=number(1, 65))
    """Maximum depth of the time-of-flight camera, m."""
    holes: Range = field(default=(0.2, 1.0), metadata=number(0, 1))
    """Strength of all other errors, 0 to 1: lost readings, and surfaces that bleed or mix at
    edges."""
    half_resolution: bool = True
    """The sensor has half the rows and columns of the image, so that each reading fills 2x2 px, as
    with sensors that compute depth on board."""
    exact_range_m: float = field(default=25.0, metadata=number(1, 65))
    """Maximum of the exact depth that is stored beside the measured one, m."""
    exact_stride_px: int = field(default=1, metadata=number(1, 8))
    """The exact depth is stored for every n-th pixel of every n-th row."""
    in_haze: bool = field(default=False, metadata=OMIT_DEFAULT)
    """Fog and haze reduce contrast and light: more noise and lost readings."""
