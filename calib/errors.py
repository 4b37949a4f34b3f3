"""Errors of calib, and why it could not find something."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from basetree.deprecation import moved_names
from basetree.errors import InputError

__getattr__ = moved_names(
    __name__,
    {
        "CalibError": "basetree.errors.InputError",
        "InputFileError": "basetree.errors.InputFileError",
    },
)


class CameraError(InputError):
    """Invalid camera, or a camera that does not match the image."""


class DepthError(InputError):
    """Depth map or encoding of the wrong shape, dtype or unit."""


class CloudError(InputError):
    """Point cloud that is damaged, empty, of another format, or outside of the picture."""


@dataclass(frozen=True)
class Failure:
    """The reason why something could not be found. Falsy."""

    reason: str

    def __bool__(self) -> Literal[False]:
        return False
