"""Errors of perceptree.

PerceptreeError
├── SettingsError      a setting out of its range
├── DatasetError       frames or labels that are missing, unreadable or contradict each other
└── CheckpointError    a file that is not a checkpoint of this project, or cannot be written
"""

from __future__ import annotations


class PerceptreeError(Exception):
    """Anything that perceptree refuses; its text is one line for the user."""

    exit_code = 2


class SettingsError(PerceptreeError):
    """A setting out of its range."""


class DatasetError(PerceptreeError):
    """Frames or labels that are missing, unreadable or contradict each other."""


class CheckpointError(PerceptreeError):
    """A file that is not a checkpoint of this project, or cannot be written."""
