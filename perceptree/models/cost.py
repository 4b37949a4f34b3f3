"""Size of a network: its number of parameters, and the multiply-adds of one frame.

Multiply-adds are counted in convolutions and fully connected layers, as publications do. One
multiply-add is two FLOPs. RoIAlign, non-maximum suppression and keypoint decoding are not counted.
"""

from __future__ import annotations

from itertools import chain
from typing import Any, NamedTuple

import torch
from torch import nn
from torch.func import functional_call
from torch.utils.flop_counter import FlopCounterMode

from perceptree.models.backbones import make_timm
from perceptree.models.detector import TreeRCNN
from perceptree.models.heads import BOX_CELLS, ROI_CELLS

CLASSIFIER_SIDE_PX = 224

_FLOPS_PER_MULTIPLY_ADD = 2


class ClassifierCost(NamedTuple):
    """Size of a backbone as an ImageNet classifier (1000 classes, one 224x224 px image)."""

    parameters: int
    multiply_adds: int


def parameters(module: nn.Module) -> int:
    """Count the parameters of a network, frozen ones included, running statistics excluded."""
    return sum(value.numel() for value in module.parameters())


def multiply_adds(model: TreeRCNN) -> int:
    """Count the multiply-adds of `detect` for one frame with the maximum number of regions."""
    return sum(multiply_adds_by_part(model).values())


def multiply_adds_by_part(model: TreeRCNN) -> dict[str, int]:
    """Count the multiply-adds of each part of a model, as `multiply_adds` does.

    Returns:
        Multiply-adds by part, in the order of execution: `backbone`, `pyramid`,
        `proposals`, `box_head` and, where the model has them, `mask_head`, `keypoint_head` and
        `colour`, the colour backbone with its way into the pyramid.
    """
    spec = model.spec
    height, width = (32 * cells for cells in spec.map_size(5))
    result = {}
    sides = height // spec.reduction, width // spec.reduction
    image = torch.empty(1, spec.channels, *sides, device="meta")
    maps, result["backbone"] = _run(model.backbone, image)
    maps, result["pyramid"] = _run(model.pyramid, maps)
    _, result["proposals"] = _run(model.proposer, maps)
    heads = (
        ("box_head", model.box_head, spec.proposals, BOX_CELLS),
        ("mask_head", model.mask_head, spec.detections, ROI_CELLS),
        ("keypoint_head", model.keypoint_head, spec.detections, ROI_CELLS),
    )
    for name, head, regions, cells in heads:
        if head is not None:
            pooled = torch.empty(regions, spec.fpn_width, cells, cells, device="meta")
            _, result[name] = _run(head, pooled)
    if model.colour_backbone is not None and model.colour_lateral is not None:
        sides = height // spec.colour_reduction, width // spec.colour_reduction
        image = torch.empty(1, 3, *sides, device="meta")
        maps, result["colour"] = _run(model.colour_backbone, image)
        for layer, x in zip(model.colour_lateral, maps, strict=True):
            result["colour"] += _run(layer, x)[1]
    return result


def classifier_cost(backbone: str, stride_in_1x1: bool = False) -> ClassifierCost:
    """Compute the size of a backbone as an image classifier, which publications state.

    Args:
        backbone: A key of `backbones.BACKBONES`.
        stride_in_1x1: As for `backbones.Backbone`.

    Raises:
        SpecError: If the backbone is unknown.
    """
    with torch.device("meta"):
        network = make_timm(backbone, stride_in_1x1).eval()
        image = torch.empty(1, 3, CLASSIFIER_SIDE_PX, CLASSIFIER_SIDE_PX)
    return ClassifierCost(parameters(network), _run(network, image)[1])


def _run(module: nn.Module, inputs: Any) -> tuple[Any, int]:
    """The output and the multiply-adds of a module for inputs on the meta device (shapes only)."""
    tensors = chain(module.named_parameters(), module.named_buffers())
    shapes = {name: value.detach().to("meta") for name, value in tensors}
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        outputs = functional_call(module, shapes, (inputs,))
    return outputs, counter.get_total_flops() // _FLOPS_PER_MULTIPLY_ADD
