"""Model files: the manifest, and a safety check before a file is opened."""

from edgetree.model_file.manifest import Manifest

__all__ = ["Manifest"]
