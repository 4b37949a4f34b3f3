"""Settings of the camera, the colour sensor and the depth sensor."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from basetree.errors import SettingsError
from calib import PinholeCamera
from perceptree.simulator.settings.checks import (
    OMIT_DEFAULT,
    Range,
    Shares,
    check_number,
    check_range,
    check_shares,
)

DEPTH_KINDS = ("stereo", "tof")


def ideal_camera(width: int, height: int, horizontal_fov_deg: float = 85.0) -> PinholeCamera:
    """Make a centred camera with square pixels and no distortion, like a rectified ZED image.

    Args:
        width: Image width, px; even and at least 64.
        height: Image height, px; even and at least 64.
        horizontal_fov_deg: Horizontal field of view, 20 to 130 degrees.

    Raises:
        SettingsError: If a value is out of range.
    """
    for name, value in (("width", width), ("height", height)):
        if value < 64 or value % 2:
            raise SettingsError(f"camera {name} is {value}: expected an even number >= 64")
    check_number("horizontal_fov_deg", horizontal_fov_deg, 20.0, 130.0)
    focal = 0.5 * width / math.tan(math.radians(horizontal_fov_deg) / 2)
    return PinholeCamera(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2)


@dataclass(frozen=True)
class PoseSettings:
    """How a camera is carried. Each view draws from these ranges.

    Attributes:
        height_m: Height above the ground, m.
        pitch_deg: Pitch, positive upwards.
        roll_deg: Roll.

    Raises:
        SettingsError: If a value is out of range.
    """

    height_m: Range
    pitch_deg: Range
    roll_deg: Range

    def __post_init__(self) -> None:
        check_range("height_m", self.height_m, 0.3, 10.0)
        check_range("pitch_deg", self.pitch_deg, -60.0, 30.0)
        check_range("roll_deg", self.roll_deg, -30.0, 30.0)


@dataclass(frozen=True)
class CameraSettings:
    """The camera.

    Attributes:
        intrinsics: Intrinsics; width and height are even.
        mast: How the camera is carried on a machine's mast.
        hand: How the camera is carried by hand.
        mast_share: Fraction of the views from a mast.

    Raises:
        SettingsError: If a value is out of range.
    """

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
        """Make the default camera with another image size, as :func:`ideal_camera`."""
        return cls(ideal_camera(width, height, horizontal_fov_deg))


@dataclass(frozen=True)
class RgbSettings:
    """The colour sensor. Each frame draws from these ranges.

    Attributes:
        exposure: Exposure of the metered mean; 1 makes it middle grey.
        noise: Standard deviation of the noise at middle grey by day, as a fraction of full scale.
        blur_px: Standard deviation of the lens's Gaussian blur, px.
        motion_px: Length of a straight motion blur, px.
        motion_share: Fraction of frames with motion blur.
        white_balance: Error of the red and blue gains.
        jpeg_quality: Quality of JPEG files.
        dusk_exposure: Factor of the exposure at dusk.

    Raises:
        SettingsError: If a value is out of range.
    """

    exposure: Range = (0.45, 0.9)
    noise: Range = (0.003, 0.012)
    blur_px: Range = (0.0, 1.0)
    motion_px: Range = (0.0, 4.0)
    motion_share: float = 0.2
    white_balance: Range = (-0.12, 0.12)
    jpeg_quality: int = 85
    dusk_exposure: float = field(default=0.55, metadata=OMIT_DEFAULT)

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
    """The depth sensor. Each frame draws a kind, and its parameters from these ranges.

    Attributes:
        kinds: Weight of each of DEPTH_KINDS.
        baseline_m: Baseline of the stereo camera, m.
        disparity_noise_px: Standard deviation of the disparity, px of the image. The standard
            deviation of the depth is z² / (f b) times that.
        disparity_step_px: Quantisation of the disparity, px of the image.
        stereo_range_m: Maximum depth of the stereo camera, m.
        tof_noise_per_m: Standard deviation of a time-of-flight camera's depth over z², 1/m.
        tof_range_m: Maximum depth of the time-of-flight camera, m.
        holes: Strength of all other errors, 0 to 1: lost readings, and surfaces that bleed or mix
            at edges.
        half_resolution: The sensor has half the rows and columns of the image, so that each
            reading fills 2x2 px, as with sensors that compute depth on board.
        exact_range_m: Maximum of the exact depth that is stored beside the measured one, m.
        exact_stride_px: The exact depth is stored for every n-th pixel of every n-th row.
        in_haze: Fog and haze reduce contrast and light: more noise and lost readings.

    Raises:
        SettingsError: If a value is out of range.
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
    in_haze: bool = field(default=False, metadata=OMIT_DEFAULT)

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
