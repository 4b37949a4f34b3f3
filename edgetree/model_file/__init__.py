"""What a model file is: its manifest, and the checks before anything opens it."""

from edgetree.model_file.manifest import Manifest

__all__ = ["Manifest"]
