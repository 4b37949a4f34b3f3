"""Training: from random or published weights, on the CPU first."""

from perceptree.training.settings import TrainSettings
from perceptree.training.starting import Init
from perceptree.training.trainer import Status, TrainReport, train

__all__ = ["Init", "Status", "TrainReport", "TrainSettings", "train"]
