"""Measure stems without depth: another way to their distance, then the same widths and errors."""

from edgetree.measure.without_depth.camera_height import CameraHeight
from edgetree.measure.without_depth.entry import measure_without_depth
from edgetree.measure.without_depth.placement import Placement, SeenStems, Way

__all__ = ["CameraHeight", "Placement", "SeenStems", "Way", "measure_without_depth"]
