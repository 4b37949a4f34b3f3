"""Settings of the depth cameras that a training draws on exact depth."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings, limits, weights

CAMERA_KINDS = ("stereo", "tof", "lidar", "exact")

_SHARE = limits(0, 1)
_KINDS = {"stereo": 3.0, "tof": 3.0, "lidar": 1.0, "exact": 1.0}


@dataclass(frozen=True)
class CameraSettings(Settings):
    """Depth cameras that are drawn on exact depth, each frame another one.

    They apply to frames of a dataset that is read with `exact_depth`, in place of the geometric
    changes.
    """

    camera_kinds: dict[str, float] = field(
        default_factory=lambda: dict(_KINDS), metadata=weights(CAMERA_KINDS)
    )
    """Weight of each kind: a stereo pair, time of flight, a lidar's beams in the picture, and exact
    depth."""
    camera_width_px: tuple[float, float] = field(default=(160, 1280), metadata=limits(32, 4096))
    """Minimum and maximum width of the sensor's picture in px, drawn uniformly in its logarithm."""
    camera_range_m: tuple[float, float] = field(default=(1.5, 20), metadata=limits(0.5, 65))
    """Minimum and maximum range of the sensor in m, drawn uniformly in its logarithm."""
    camera_zoom: tuple[float, float] = field(default=(0.7, 4), metadata=limits(0.1, 16))
    """Minimum and maximum magnification, drawn uniformly in its logarithm: partly a longer focal
    length, partly a camera that is nearer."""
    camera_matching_px: int = field(default=4, metadata=limits(0, 15, whole=True))
    """Maximum width by which the matching of a stereo pair widens what is near, px of the
    sensor."""
    portrait_share: float = field(default=0.25, metadata=_SHARE)
    """Share of the pictures in portrait."""
    above_share: float = field(default=0.15, metadata=_SHARE)
    """Share of the pictures that begin at the frame's upper border, most of them without
    ground."""
    bare_share: float = field(default=0.2, metadata=_SHARE)
    """Share of the pictures without readings of the ground."""
    ghost_share: float = field(default=0.15, metadata=_SHARE)
    """Share of the pictures whose holes show an earlier picture."""
