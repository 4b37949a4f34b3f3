"""The core trainer: simulator, datasets, models, training and evaluation."""

from perceptree.errors import CheckpointError, DatasetError, PerceptreeError, SettingsError

__all__ = ["CheckpointError", "DatasetError", "PerceptreeError", "SettingsError"]
