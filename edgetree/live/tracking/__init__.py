"""Stems followed over time: in three dimensions with measurements fused, or in the picture."""

from edgetree.live.tracking.odometry import DepthOdometry
from edgetree.live.tracking.picture_tracker import PictureTracker
from edgetree.live.tracking.settings import ErrorShares, TrackingSettings
from edgetree.live.tracking.tracker import StemTracker
from edgetree.live.tracking.tracks import TreeTrack

__all__ = [
    "DepthOdometry",
    "ErrorShares",
    "PictureTracker",
    "StemTracker",
    "TrackingSettings",
    "TreeTrack",
]
