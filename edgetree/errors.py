"""Errors of edgetree, and the packages that training and export need."""

from __future__ import annotations

from typing import Final

from basetree.deprecation import moved_names
from basetree.errors import InputError

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

__getattr__ = moved_names(
    __name__,
    {
        "CheckFailed": "basetree.errors.CheckFailed",
        "EdgetreeError": "basetree.errors.EdgetreeError",
        "MissingDependency": "basetree.errors.MissingPackage",
        "install_hint": "basetree.errors.install_hint",
    },
)


class ModelFileError(InputError):
    """A model file is missing, is not an ONNX model, or has no valid manifest."""


class ServiceError(InputError):
    """The service for other programs does not answer, or cannot use a frame."""


class SignatureError(ModelFileError):
    """A model's signature is required, and is missing or not accepted."""
