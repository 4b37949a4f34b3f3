"""The proposal network's convolution as a depthwise and a pointwise one, which take less time.

Howard et al. 2017, "MobileNets: Efficient Convolutional Neural Networks for Mobile Vision
Applications". As in ThunderNet (Qin et al. 2019) the depthwise one has 5x5 taps: they cost little,
and trees are tall.
"""

from __future__ import annotations

import dataclasses

import torch
from torch import Tensor, nn

from perceptree.models.detector import TreeRCNN
from perceptree.models.rpn import SEPARABLE_SIDE
from perceptree.models.spec import SpecError


def with_separable_proposals(model: TreeRCNN) -> TreeRCNN:
    """A copy of a model whose proposal network has a depthwise and a pointwise convolution.

    They are the closest ones to the dense convolution of the model; as that is only near, the copy
    needs training.

    Args:
        model: A model with a dense convolution; it is not changed.

    Raises:
        SpecError: If the convolution is separable already.
    """
    if model.spec.separable_proposals:
        raise SpecError(f"separable_proposals is true for {model.spec.name}, expected false")
    made = TreeRCNN(dataclasses.replace(model.spec, separable_proposals=True))
    weights = model.state_dict()
    name = "proposer.conv"
    depthwise, pointwise = _split(weights.pop(f"{name}.weight"))
    weights |= {
        f"{name}.0.weight": depthwise,
        f"{name}.1.weight": pointwise,
        f"{name}.1.bias": weights.pop(f"{name}.bias"),
    }
    made.load_state_dict(weights)
    return made.train(model.training)


def _split(weight: Tensor) -> tuple[Tensor, Tensor]:
    """The depthwise and pointwise weights whose product is closest to a dense weight.

    For each input channel they are the first term of the singular value decomposition of its
    outputs x taps. The taps of a channel have the absolute sum 1, so that the maps in between have
    the range of the input, which rounding to 8 bits needs.

    Args:
        weight: (out, in, k, k).

    Returns:
        (in, 1, 5, 5) with zeros around the k x k taps, and (out, in, 1, 1).
    """
    outer, inner, side, _ = weight.shape
    left, size, right = torch.linalg.svd(weight.transpose(0, 1).flatten(2), full_matrices=False)
    taps, outputs = right[:, 0], left[:, :, 0] * size[:, :1]
    scale = taps.abs().sum(1, keepdim=True).clamp(min=torch.finfo(taps.dtype).tiny)
    border = (SEPARABLE_SIDE - side) // 2
    depthwise = nn.functional.pad((taps / scale).reshape(inner, 1, side, side), (border,) * 4)
    return depthwise, (outputs * scale).T.reshape(outer, inner, 1, 1).contiguous()
