"""Everything that edgetree raises on purpose.

    EdgetreeError            exit code 1
    ├── CheckFailed          exit code 1: the work was done, and a check on its result failed
    ├── InputError           exit code 2: a file, folder or value given by the user cannot be used
    │   └── ModelFileError   exit code 2: a model file is missing, no ONNX, or not ours
    └── MissingDependency    exit code 2: an optional package is not installed

Every message is one line that names the file, says what was found and what was expected, so the
command line can print it as it is.
"""

from __future__ import annotations

from typing import ClassVar

__all__ = ["CheckFailed", "EdgetreeError", "InputError", "MissingDependency", "ModelFileError"]


class EdgetreeError(Exception):
    """Base of all errors that edgetree raises on purpose."""

    exit_code: ClassVar[int] = 1


class CheckFailed(EdgetreeError):
    """The work was done, but its result did not pass a check (parity, a limit)."""


class InputError(EdgetreeError):
    """A file, folder, array or value handed in cannot be used."""

    exit_code = 2


class ModelFileError(InputError):
    """A model file is missing, is no ONNX model, or carries no usable manifest."""


class MissingDependency(EdgetreeError):
    """An optional package that this work needs is not installed."""

    exit_code = 2
