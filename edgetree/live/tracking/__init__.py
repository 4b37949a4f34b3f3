"""Stems followed over time in three dimensions, and their measurements fused."""

from edgetree.live.tracking.odometry import DepthOdometry
from edgetree.live.tracking.settings import ErrorShares, TrackingSettings
from edgetree.live.tracking.tracker import StemTracker
from edgetree.live.tracking.tracks import TreeTrack

__all__ = ["DepthOdometry", "ErrorShares", "StemTracker", "TrackingSettings", "TreeTrack"]
