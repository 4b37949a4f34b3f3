"""What a network costs: its parameters, and the multiply-adds of one frame.

Multiply-adds are those of convolutions and fully connected layers, as publications count them;
what a profiler calls a FLOP is half of one. Pooling of regions, suppression and the reading of
keypoints come on top and are small beside them.
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
    """Of a backbone as an ImageNet classifier of 1000 classes, for one 224x224 px image."""

    parameters: int
    multiply_adds: int


def parameters(module: nn.Module) -> int:
    """Trained numbers of a network, the frozen ones too; running statistics are none."""
    return sum(value.numel() for value in module.parameters())


def multiply_adds(model: TreeRCNN) -> int:
    """Of one ``detect`` of one frame of the spec's size, with all its proposals and rows."""
    return sum(multiply_adds_by_part(model).values())


def multiply_adds_by_part(model: TreeRCNN) -> dict[str, int]:
    """As :func:`multiply_adds`, by part in the order of the work.

    The parts are ``backbone``, ``pyramid``, ``proposals``, ``box_head`` and, where the model has
    them, ``mask_head`` and ``keypoint_head``.
    """
    spec = model.spec
    height, width = (32 * cells for cells in spec.map_size(5))
    result = {}
    image = torch.empty(1, spec.channels, height, width, device="meta")
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
    return result


def classifier_cost(backbone: str, stride_in_1x1: bool = False) -> ClassifierCost:
    """What publications give as the cost of a detector's backbone, by our name of it.

    Raises SpecError for a backbone that we have not.
    """
    with torch.device("meta"):
        network = make_timm(backbone, stride_in_1x1).eval()
        image = torch.empty(1, 3, CLASSIFIER_SIDE_PX, CLASSIFIER_SIDE_PX)
    return ClassifierCost(parameters(network), _run(network, image)[1])


def _run(module: nn.Module, inputs: Any) -> tuple[Any, int]:
    """A module's output for inputs of a shape only, and its multiply-adds; computes nothing."""
    tensors = chain(module.named_parameters(), module.named_buffers())
    shapes = {name: value.detach().to("meta") for name, value in tensors}
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        outputs = functional_call(module, shapes, (inputs,))
    return outputs, counter.get_total_flops() // _FLOPS_PER_MULTIPLY_ADD
