"""Errors of perceptree."""

from __future__ import annotations

from basetree.errors import InputError


class DatasetError(InputError):
    """Missing, unreadable or inconsistent frames or labels."""


class CheckpointError(InputError):
    """A file that is not a checkpoint of this project, or that cannot be written."""
