"""Run model files with onnxruntime: from an image to the trees in it.

`FakeSession` replaces a model file in tests of programs that use a detector.
"""

from edgetree.catalogue import default_model
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.pairs import ColourAndDepth
from edgetree.runtime.providers import PROVIDERS, SessionSettings
from edgetree.runtime.session import FakeSession, InferenceSession

__all__ = [
    "PROVIDERS",
    "ColourAndDepth",
    "FakeSession",
    "InferenceSession",
    "SessionSettings",
    "TreeDetector",
    "default_model",
]
