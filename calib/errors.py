"""Errors of calib."""

from __future__ import annotations

from basetree.errors import InputError


class CameraError(InputError):
    """Invalid camera, or a camera that does not match the image."""


class DepthError(InputError):
    """Depth map or encoding of the wrong shape, dtype or unit."""
