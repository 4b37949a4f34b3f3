"""The exceptions of edgetree.

    EdgetreeError            exit code 1
    ├── CheckFailed          exit code 1: the result did not pass a check
    ├── InputError           exit code 2: a file, folder or value given by the user cannot be used
    │   └── ModelFileError   exit code 2: a model file is missing, broken or not made by edgetree
    │       └── SignatureError   exit code 2: a signature is required, and missing or not accepted
    └── MissingDependency    exit code 2: an optional package is not installed

Every message is one line that names the file, what was found and what was expected. The command
line prints it unchanged.
"""

from __future__ import annotations

from typing import ClassVar, Final

__all__ = [
    "TRAINING_PACKAGES",
    "CheckFailed",
    "EdgetreeError",
    "InputError",
    "MissingDependency",
    "ModelFileError",
    "SignatureError",
    "install_hint",
]


TRAINING_PACKAGES: Final = (
    "torch",
    "torchvision",
    "timm",
    "pycocotools",
    "safetensors",
    "numba",
    "onnx",
    "onnxscript",
)
"""Packages of the extras train, export and sim that these need, by distribution and module."""


class EdgetreeError(Exception):
    """Base class of the exceptions of edgetree."""

    exit_code: ClassVar[int] = 1


class CheckFailed(EdgetreeError):
    """The result did not pass a check, such as the parity check of an export."""


class InputError(EdgetreeError):
    """A file, folder, array or value given by the user cannot be used."""

    exit_code = 2


class ModelFileError(InputError):
    """A model file is missing, is not an ONNX model, or has no valid manifest."""


class SignatureError(ModelFileError):
    """A model's signature is required, and is missing or not accepted."""


class MissingDependency(EdgetreeError):
    """An optional package is needed but not installed."""

    exit_code = 2


def install_hint(*extras: str) -> str:
    """The pip command that installs these extras of the project, for error messages."""
    return f"""pip install ".[{",".join(extras)}]" in the project's folder"""
