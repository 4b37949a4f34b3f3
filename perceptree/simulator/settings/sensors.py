"""Settings of the camera, the colour sensor and the depth sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from calib import PinholeCamera
from perceptree.errors import SettingsError
from perceptree.simulator.settings.checks import (
    LATER,
    Range,
    Shares,
    check_number,
    check_range,
    check_shares,
)

DEPTH_KINDS = ("stereo", "tof")


def ideal_camera(width: int, height: int, horizontal_fov_deg: float = 85.0) -> PinholeCamera:
    """A centred camera with square pixels and no distortion, as a ZED's rectified image has.

    Raises SettingsError for sizes that are odd or below 64 px, or a field of view outside 20 to
    130 degrees.
    """
    for name, value in (("width", width), ("height", height)):
        if value < 64 or value % 2:
            raise SettingsError(f"camera {name} is {value}: expected an even number >= 64")
    check_number("horizontal_fov_deg", horizontal_fov_deg, 20.0, 130.0)
    focal = 0.5 * width / math.tan(math.radians(horizontal_fov_deg) / 2)
    return PinholeCamera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


@dataclass(frozen=True)
class PoseSettings:
    """How a camera is carried: height above ground, pitch (up is positive) and roll."""

    height_m: Range
    pitch_deg: Range
    roll_deg: Range

    def __post_init__(self) -> None:
        check_range("height_m", self.height_m, 0.3, 10.0)
        check_range("pitch_deg", self.pitch_deg, -60.0, 30.0)
        check_range("roll_deg", self.roll_deg, -30.0, 30.0)


@dataclass(frozen=True)
class CameraSettings:
    """The camera and how it is carried: on a machine's mast or in a person's hand."""

    intrinsics: PinholeCamera = field(default_factory=lambda: ideal_camera(1280, 720))
    mast: PoseSettings = PoseSettings((2.0, 3.4), (-22.0, -2.0), (-5.0, 5.0))
    hand: PoseSettings = PoseSettings((1.2, 1.9), (-12.0, 6.0), (-6.0, 6.0))
    mast_share: float = 0.5

    def __post_init__(self) -> None:
        for name in ("width", "height"):
            value = getattr(self.intrinsics, name)
            if value < 64 or value % 2:
                raise SettingsError(f"camera {name} is {value}: expected an even number >= 64")
        check_number("mast_share", self.mast_share, 0.0, 1.0)

    @classmethod
    def of_size(cls, width: int, height: int, horizontal_fov_deg: float = 85.0) -> CameraSettings:
        """The default camera at another image size."""
        return cls(ideal_camera(width, height, horizontal_fov_deg))


@dataclass(frozen=True)
class RgbSettings:
    """What the colour sensor adds. Each frame draws from these ranges.

    ``exposure`` is the metered mean's place on the tone curve, 1 at middle grey; ``noise`` the
    standard deviation at middle grey by day, as a share of full scale; ``blur_px`` the lens's
    Gaussian blur; ``motion_px`` the length of a straight motion blur in ``motion_share`` of the
    frames; ``white_balance`` the error of the red and blue gains; ``dusk_exposure`` the share of
    the exposure that is left at dusk.
    """

    exposure: Range = (0.45, 0.9)
    noise: Range = (0.003, 0.012)
    blur_px: Range = (0.0, 1.0)
    motion_px: Range = (0.0, 4.0)
    motion_share: float = 0.2
    white_balance: Range = (-0.12, 0.12)
    jpeg_quality: int = 85
    dusk_exposure: float = field(default=0.55, metadata=LATER)

    def __post_init__(self) -> None:
        check_range("exposure", self.exposure, 0.05, 5.0)
        check_range("noise", self.noise, 0.0, 0.5)
        check_range("blur_px", self.blur_px, 0.0, 5.0)
        check_range("motion_px", self.motion_px, 0.0, 40.0)
        check_number("motion_share", self.motion_share, 0.0, 1.0)
        check_range("white_balance", self.white_balance, -0.5, 0.5)
        check_number("jpeg_quality", self.jpeg_quality, 30, 100)
        check_number("dusk_exposure", self.dusk_exposure, 0.05, 1.0)


@dataclass(frozen=True)
class DepthSettings:
    """What the depth sensor makes of the exact depth. Each frame draws its kind and noise.

    A stereo camera's disparity, in px of the image, has ``disparity_noise_px`` of noise and steps
    of ``disparity_step_px``: the depth's deviation is z² / (f b) times that. A time-of-flight
    camera's depth has ``tof_noise_per_m`` times z² metres. ``holes`` from 0 to 1 scales all that
    goes wrong besides: lost readings, and surfaces that bleed or mix at edges. With
    ``half_resolution`` the sensor has half the image's rows and columns, as those that work on
    board have, and each reading fills 2x2 px. The exact depth is written beside it, up to
    ``exact_range_m``, at every ``exact_stride_px``-th pixel of every such row. With ``in_haze``
    fog and haze take contrast and light from the sensor: more noise, lost readings.
    """

    kinds: Shares = field(default_factory=lambda: {"stereo": 3.0, "tof": 1.0})
    baseline_m: Range = (0.06, 0.12)
    disparity_noise_px: Range = (0.05, 0.2)
    disparity_step_px: float = 0.0625
    stereo_range_m: Range = (15.0, 25.0)
    tof_noise_per_m: Range = (0.0003, 0.002)
    tof_range_m: Range = (6.0, 12.0)
    holes: Range = (0.2, 1.0)
    half_resolution: bool = True
    exact_range_m: float = 25.0
    exact_stride_px: int = 1
    in_haze: bool = field(default=False, metadata=LATER)

    def __post_init__(self) -> None:
        check_shares("depth kinds", self.kinds, DEPTH_KINDS)
        check_range("baseline_m", self.baseline_m, 0.02, 1.0)
        check_range("disparity_noise_px", self.disparity_noise_px, 0.0, 5.0)
        check_number("disparity_step_px", self.disparity_step_px, 0.001, 1.0)
        check_range("stereo_range_m", self.stereo_range_m, 1.0, 65.0)
        check_range("tof_noise_per_m", self.tof_noise_per_m, 0.0, 0.05)
        check_range("tof_range_m", self.tof_range_m, 1.0, 65.0)
        check_range("holes", self.holes, 0.0, 1.0)
        check_number("exact_range_m", self.exact_range_m, 1.0, 65.0)
        check_number("exact_stride_px", self.exact_stride_px, 1, 8)
