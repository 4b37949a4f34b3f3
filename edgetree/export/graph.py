"""The export-only wrapper around a trained model, and its translation to ONNX."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from edgetree.export.quiet import quiet
from edgetree.export.rewrites import deployable
from edgetree.export.settings import OPSET

if TYPE_CHECKING:
    from perceptree.models import TreeRCNN

__all__ = ["output_names", "trace"]


def output_names(masks: bool, keypoints: bool) -> tuple[str, ...]:
    """Outputs in the order of the design; those of absent branches are absent."""
    return (
        "boxes",
        "scores",
        *(["keypoints"] if keypoints else []),
        *(["masks"] if masks else []),
        "num_detections",
    )


def trace(model: TreeRCNN, batch: int, opset: int = OPSET, *, quantised: bool = False) -> Any:
    """An ``onnx.ModelProto`` of ``model.detect`` with static shapes, float32.

    ``quantised`` gives it the form that ``edgetree.export.quantise`` takes. The model has no
    branch on data, so what it is traced on does not matter.
    """
    import torch

    names = output_names(model.spec.masks, model.spec.keypoints)
    deployed = deployable(model, quantised=quantised)

    class Exported(torch.nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.model = deployed

        def forward(self, image: torch.Tensor) -> tuple[torch.Tensor, ...]:
            found = deployed.detect(image)._asdict()
            return tuple(found[name] for name in names)

    spec = model.spec
    shape = (spec.height, spec.width, 3)[: 3 if spec.modality == "rgb" else 2]
    with quiet():
        program = torch.onnx.export(
            Exported().eval(),
            (torch.zeros(batch, *shape, dtype=torch.uint8),),
            dynamo=True,
            input_names=["image"],
            output_names=list(names),
            opset_version=opset,
            verbose=False,
        )
    if program is None:
        raise RuntimeError("torch.onnx.export gave no program")
    return program.model_proto
