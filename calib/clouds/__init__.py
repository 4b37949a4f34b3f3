"""Point clouds of laser scanners: files of all common formats, and clouds in a camera's picture."""

from calib.clouds.beams import BeamDepth, Spacing, depth_of_beams, fill_between, grown_across
from calib.clouds.cloud import PointCloud
from calib.clouds.files import CLOUD_SUFFIXES, is_cloud_file, read_cloud

__all__ = [
    "CLOUD_SUFFIXES",
    "BeamDepth",
    "PointCloud",
    "Spacing",
    "depth_of_beams",
    "fill_between",
    "grown_across",
    "is_cloud_file",
    "read_cloud",
]
