"""From detections, depth and a camera to metres, each with a standard deviation or a reason."""

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
