"""Errors of perceptree."""

from __future__ import annotations

from basetree.deprecation import moved_names
from basetree.errors import InputError

__getattr__ = moved_names(
    __name__,
    {
        "PerceptreeError": "basetree.errors.InputError",
        "SettingsError": "basetree.errors.SettingsError",
        "MissingPackage": "basetree.errors.MissingPackage",
    },
)


class DatasetError(InputError):
    """Missing, unreadable or inconsistent frames or labels."""


class CheckpointError(InputError):
    """A file that is not a checkpoint of this project, or that cannot be written."""
