"""Errors of calib.

CalibError
├── CameraError        invalid camera, or a camera that does not match the image
├── DepthError         depth map or encoding of the wrong shape, dtype or unit
└── InputFileError     missing, unreadable or unsupported file
"""

from __future__ import annotations


class CalibError(Exception):
    """Base class of calib's errors; the message is one line meant for the user."""

    exit_code = 2


class CameraError(CalibError):
    """Invalid camera, or a camera that does not match the image."""


class DepthError(CalibError):
    """Depth map or encoding of the wrong shape, dtype or unit."""


class InputFileError(CalibError):
    """Missing, unreadable or unsupported file."""
