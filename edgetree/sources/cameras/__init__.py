"""Cameras: those that OpenCV reads, and those with a package of their maker."""

from edgetree.sources.cameras.oak import open_oak
from edgetree.sources.cameras.opencv import open_camera
from edgetree.sources.cameras.orbbec import open_orbbec
from edgetree.sources.cameras.realsense import open_realsense

__all__ = ["open_camera", "open_oak", "open_orbbec", "open_realsense"]
