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
from edgetree.measure.profile import StemProfile
from edgetree.measure.rig_uncertainty import EXACT_RIG, RigUncertainty
from edgetree.measure.settings import MeasureSettings
from edgetree.measure.volume import SPECIES, Species, stem_volume

__all__ = [
    "EXACT_RIG",
    "QUANTITIES",
    "SPECIES",
    "Estimate",
    "Evidence",
    "Failure",
    "MeasureSettings",
    "PointEstimate",
    "RigUncertainty",
    "Species",
    "StemAxis",
    "StemProfile",
    "TreeMeasurement",
    "measure_trees",
    "stem_volume",
]
