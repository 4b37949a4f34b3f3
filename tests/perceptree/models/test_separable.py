"""A proposal network with a depthwise and a pointwise convolution in place of a dense one."""

from pathlib import Path
from typing import Any

import pytest
import torch
from narrow_networks import narrow_spec
from torch import Tensor

from perceptree.models import SpecError, TreeRCNN, load_checkpoint, save_checkpoint
from perceptree.models.branches import pruned
from perceptree.models.cost import multiply_adds_by_part
from perceptree.models.separable import with_separable_proposals


def network(modality: str = "both", **changes: Any) -> TreeRCNN:
    torch.manual_seed(0)
    return TreeRCNN(narrow_spec(modality, **changes)).eval()


def maps(model: TreeRCNN) -> list[Tensor]:
    width = model.spec.fpn_width
    random = torch.Generator().manual_seed(1)
    sizes = [model.spec.map_size(level) for level in model.spec.levels]
    return [torch.randn(2, width, *size, generator=random) for size in sizes]


def assert_same(expected: list[Tensor], found: list[Tensor]) -> None:
    for one, other in zip(expected, found, strict=True):
        torch.testing.assert_close(one, other, atol=1e-5, rtol=1e-4)


@torch.inference_mode()
def test_a_dense_convolution_that_is_separable_keeps_its_output() -> None:
    model = network()
    convolution: Any = model.proposer.conv
    width = model.spec.fpn_width
    torch.manual_seed(2)
    taps, outputs = torch.randn(width, 3, 3), torch.randn(width, width)
    convolution.weight.copy_(outputs[:, :, None, None] * taps)
    torch.nn.init.normal_(convolution.bias)
    made = with_separable_proposals(model)
    expected, found = model.proposer(maps(model)), made.proposer(maps(model))
    assert_same(expected.logits + expected.deltas, found.logits + found.deltas)


@torch.inference_mode()
def test_the_copy_has_the_nearest_weights_and_the_others_of_the_model() -> None:
    model = network()
    dense: Any = model.proposer.conv
    before = dense.weight.clone()
    made = with_separable_proposals(model)
    convolutions: Any = made.proposer.conv
    depthwise, pointwise = convolutions
    together = pointwise.weight * depthwise.weight[:, 0, 1:4, 1:4]
    sizes = torch.linalg.svdvals(before.transpose(0, 1).flatten(2))
    lost = (sizes[:, 1:] ** 2).sum()
    torch.testing.assert_close(((together - before) ** 2).sum(), lost, rtol=1e-4, atol=1e-6)
    # Rounded to 8 bits, the maps between the two must not need a larger range than the input's.
    torch.testing.assert_close(depthwise.weight.abs().sum((1, 2, 3)), torch.ones(len(before)))
    assert torch.equal(dense.weight, before)
    kept = {k: v for k, v in model.state_dict().items() if not k.startswith("proposer.conv")}
    assert all(torch.equal(value, made.state_dict()[name]) for name, value in kept.items())


def test_a_separable_network_is_cheaper_and_keeps_its_form(tmp_path: Path) -> None:
    model = network(fpn_width=32)
    made = with_separable_proposals(model)
    costs = [multiply_adds_by_part(each)["proposals"] for each in (model, made)]
    assert costs[1] < costs[0] / 3
    save_checkpoint(tmp_path / "made.safetensors", made, {})
    loaded, _ = load_checkpoint(tmp_path / "made.safetensors")
    assert loaded.spec.separable_proposals
    assert pruned(loaded, "depth").spec.separable_proposals
    with pytest.raises(SpecError, match="separable_proposals is true"):
        with_separable_proposals(loaded)


def test_gradients_reach_both_convolutions() -> None:
    model = with_separable_proposals(network()).train()
    total = torch.stack([logits.sum() for logits in model.proposer(maps(model)).logits]).sum()
    for gradient in torch.autograd.grad(total, list(model.proposer.conv.parameters())):
        assert bool(gradient.abs().sum() > 0)
