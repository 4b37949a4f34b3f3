"""Simulator, datasets, models, training and evaluation of tree detectors."""

from perceptree.errors import CheckpointError, DatasetError, PerceptreeError, SettingsError

__all__ = ["CheckpointError", "DatasetError", "PerceptreeError", "SettingsError"]
