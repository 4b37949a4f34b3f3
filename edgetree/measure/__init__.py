"""From detections, depth and a camera to metres, each with a standard deviation or a reason."""

from edgetree.measure.estimates import Estimate, Failure, TreeMeasurement
from edgetree.measure.measure import measure_trees
from edgetree.measure.settings import MeasureSettings

__all__ = ["Estimate", "Failure", "MeasureSettings", "TreeMeasurement", "measure_trees"]
