"""Import of Detectron2 checkpoints."""

from perceptree.models.weights.importing import Imported, import_checkpoint

__all__ = ["Imported", "import_checkpoint"]
