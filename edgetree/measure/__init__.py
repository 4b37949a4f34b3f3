"""Measure stems in metres from detections, depth and a camera.

Every quantity has a standard deviation, or the reason why it could not be measured.
"""

from edgetree.measure.estimates import (
    QUANTITIES,
    Estimate,
    Evidence,
    Failure,
    PointEstimate,
    TreeMeasurement,
)
from edgetree.measure.measure import measure_trees
from edgetree.measure.settings import MeasureSettings

__all__ = [
    "QUANTITIES",
    "Estimate",
    "Evidence",
    "Failure",
    "MeasureSettings",
    "PointEstimate",
    "TreeMeasurement",
    "measure_trees",
]
