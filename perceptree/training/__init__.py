"""Training from random weights, on the CPU first."""

from perceptree.training.settings import TrainSettings
from perceptree.training.trainer import Status, TrainReport, train

__all__ = ["Status", "TrainReport", "TrainSettings", "train"]
