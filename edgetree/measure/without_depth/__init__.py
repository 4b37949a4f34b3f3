"""Measure stems without depth: another way to their distance, then the same widths and errors."""

from edgetree.measure.without_depth.camera_height import CameraHeight
from edgetree.measure.without_depth.entry import measure_without_depth
from edgetree.measure.without_depth.motion import StemViews
from edgetree.measure.without_depth.placement import Placement, SeenStems, Way
from edgetree.measure.without_depth.scale_marks import ScaleMark, ScaleMarks

__all__ = [
    "CameraHeight",
    "Placement",
    "ScaleMark",
    "ScaleMarks",
    "SeenStems",
    "StemViews",
    "Way",
    "measure_without_depth",
]
