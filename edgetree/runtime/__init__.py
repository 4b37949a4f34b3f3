"""A model file at work: from an image to the trees in it, on a provider of onnxruntime.

Tests of programs that embed a detector use `FakeSession`, which needs no model.
"""

from edgetree.runtime.detector import TreeDetector, default_model
from edgetree.runtime.providers import PROVIDERS, SessionSettings
from edgetree.runtime.session import FakeSession, InferenceSession

__all__ = [
    "PROVIDERS",
    "FakeSession",
    "InferenceSession",
    "SessionSettings",
    "TreeDetector",
    "default_model",
]
