"""Measure stems in metres from detections, depth and a camera.

Every quantity has a standard deviation, or the reason why it could not be measured.
"""

from edgetree.measure.entry import measure_trees
from edgetree.measure.estimates import (
    QUANTITIES,
    Estimate,
    Evidence,
    Failure,
    PointEstimate,
    StemAxis,
    TreeMeasurement,
)
from edgetree.measure.pixel_sizes import PixelSize, pixel_sizes
from edgetree.measure.profile import StemProfile
from edgetree.measure.rig_uncertainty import EXACT_RIG, RigUncertainty
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.volume import SPECIES, Species, stem_volume
from edgetree.measure.without_depth import (
    CameraHeight,
    Placement,
    ScaleMark,
    ScaleMarks,
    SeenStems,
    StemViews,
    Way,
    measure_without_depth,
)

__all__ = [
    "EXACT_RIG",
    "QUANTITIES",
    "SPECIES",
    "CameraHeight",
    "Estimate",
    "Evidence",
    "Failure",
    "MeasureSettings",
    "PixelSize",
    "Placement",
    "PointEstimate",
    "RigUncertainty",
    "ScaleMark",
    "ScaleMarks",
    "SeenStems",
    "Species",
    "StemAxis",
    "StemProfile",
    "StemViews",
    "TreeMeasurement",
    "Way",
    "measure_trees",
    "measure_without_depth",
    "pixel_sizes",
    "stem_volume",
]
