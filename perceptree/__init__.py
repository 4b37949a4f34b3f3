"""Simulator, datasets, models, training and evaluation of tree detectors."""

from basetree.deprecation import moved_names
from perceptree.errors import CheckpointError, DatasetError

__all__ = ["CheckpointError", "DatasetError"]

__getattr__ = moved_names(
    __name__,
    {
        "PerceptreeError": "basetree.errors.InputError",
        "SettingsError": "basetree.errors.SettingsError",
    },
)
