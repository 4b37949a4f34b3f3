"""Weights of others: Detectron2's published checkpoints become networks of ours."""

from perceptree.models.weights.importing import Imported, import_checkpoint

__all__ = ["Imported", "import_checkpoint"]
