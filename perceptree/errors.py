"""Errors of perceptree.

PerceptreeError
├── SettingsError      invalid setting
├── DatasetError       missing, unreadable or inconsistent frames or labels
├── CheckpointError    not a checkpoint of this project, or not writable
└── MissingPackage     an optional package is not installed
"""

from __future__ import annotations


class PerceptreeError(Exception):
    """Base class of perceptree's errors; the message is one line meant for the user."""

    exit_code = 2


class SettingsError(PerceptreeError):
    """Invalid setting."""


class DatasetError(PerceptreeError):
    """Missing, unreadable or inconsistent frames or labels."""


class CheckpointError(PerceptreeError):
    """A file that is not a checkpoint of this project, or that cannot be written."""


class MissingPackage(PerceptreeError):
    """An optional package is needed but not installed."""
