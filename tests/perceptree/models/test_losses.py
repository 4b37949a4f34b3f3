"""Losses against explicit loops, and their gradients against finite differences."""

import math

import pytest
import torch
from torch import Tensor
from torch.autograd import gradcheck

from perceptree.models.losses import (
    box_losses,
    keypoint_loss,
    mask_loss,
    proposal_losses,
)
from perceptree.models.matching import AnchorMatch
from perceptree.models.rpn import ProposalMaps
from perceptree.models.targets import PaddedBoxes


def some_boxes(count: int, seed: int) -> Tensor:
    random = torch.Generator().manual_seed(seed)
    corner = 100 * torch.rand(count, 2, generator=random, dtype=torch.float64)
    size = 20 + 80 * torch.rand(count, 2, generator=random, dtype=torch.float64)
    return torch.cat((corner, corner + size), dim=1)


def noise(*shape: int, seed: int = 0) -> Tensor:
    random = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=random, dtype=torch.float64)


def offsets(box: list[float], anchor: list[float], weights: tuple[float, ...]) -> list[float]:
    """Girshick's parametrisation, one box at a time."""
    width, height = anchor[2] - anchor[0], anchor[3] - anchor[1]
    dx = (box[0] + box[2] - anchor[0] - anchor[2]) / 2 / width
    dy = (box[1] + box[3] - anchor[1] - anchor[3]) / 2 / height
    dw = math.log((box[2] - box[0]) / width)
    dh = math.log((box[3] - box[1]) / height)
    return [w * d for w, d in zip(weights, (dx, dy, dw, dh), strict=True)]


def proposal_case() -> tuple[ProposalMaps, Tensor, AnchorMatch, PaddedBoxes]:
    """Two levels of 6 and 4 anchors, two images, the second without a tree."""
    maps = ProposalMaps(
        [noise(2, 6).requires_grad_(), noise(2, 4, seed=1).requires_grad_()],
        [noise(2, 6, 4, seed=2).requires_grad_(), noise(2, 4, 4, seed=3).requires_grad_()],
    )
    positive = torch.zeros(2, 10, dtype=torch.bool)
    negative = torch.zeros(2, 10, dtype=torch.bool)
    positive[0, [1, 7]] = True
    negative[0, [0, 2, 9]] = negative[1, [4, 5]] = True
    tree = torch.zeros(2, 10, dtype=torch.int64)
    tree[0, 7] = 1
    trees = PaddedBoxes(some_boxes(4, 5).reshape(2, 2, 4), torch.ones(2, 2, dtype=torch.bool))
    return maps, some_boxes(10, 6), AnchorMatch(positive, negative, tree), trees


def test_proposal_losses_are_means_over_the_sampled_anchors() -> None:
    maps, anchors, match, trees = proposal_case()
    found = proposal_losses(maps, anchors, match, trees)
    logits, deltas = torch.cat(maps.logits, dim=1), torch.cat(maps.deltas, dim=1)
    entropy = shift = 0.0
    for image in range(2):
        for row in range(10):
            value = float(logits[image, row].detach())
            if match.positive[image, row]:
                entropy += math.log1p(math.exp(-value))
                box = trees.boxes[image, match.tree[image, row]].tolist()
                wanted = offsets(box, anchors[row].tolist(), (1.0,) * 4)
                pairs = zip(deltas[image, row].tolist(), wanted, strict=True)
                shift += sum(abs(a - b) for a, b in pairs)
            elif match.negative[image, row]:
                entropy += math.log1p(math.exp(value))
    assert float(found["objectness"].detach()) == pytest.approx(entropy / 7, rel=1e-9)
    assert float(found["proposal_shift"].detach()) == pytest.approx(shift / 7, rel=1e-6)


def test_box_losses_are_means_over_the_used_regions() -> None:
    logits, shifts, boxes, truth = (
        noise(6, 2),
        noise(6, 4, seed=1),
        some_boxes(6, 1),
        some_boxes(6, 2),
    )
    positive = torch.tensor([True, True, False, False, False, False])
    used = torch.tensor([True, True, True, True, False, False])
    found = box_losses(logits, shifts, boxes, truth, positive, used)
    entropy = shift = 0.0
    for row in range(4):
        tree, background = logits[row].tolist()
        margin = background - tree if positive[row] else tree - background
        entropy += math.log1p(math.exp(margin))
        if positive[row]:
            wanted = offsets(truth[row].tolist(), boxes[row].tolist(), (10.0, 10.0, 5.0, 5.0))
            shift += sum(abs(a - b) for a, b in zip(shifts[row].tolist(), wanted, strict=True))
    assert float(found["score"]) == pytest.approx(entropy / 4, rel=1e-9)
    assert float(found["box_shift"]) == pytest.approx(shift / 4, rel=1e-6)


def test_the_mask_loss_is_the_mean_entropy_of_all_cells() -> None:
    logits, wanted = noise(2, 3, 3), (noise(2, 3, 3, seed=1) > 0).double()
    pairs = zip(logits.flatten().tolist(), wanted.flatten().tolist(), strict=True)
    entropy = [math.log1p(math.exp(-value if truth else value)) for value, truth in pairs]
    assert float(mask_loss(logits, wanted)) == pytest.approx(sum(entropy) / 18, rel=1e-9)


def test_gradients_of_the_proposal_losses_are_right() -> None:
    maps, anchors, match, trees = proposal_case()

    def total(*values: Tensor) -> tuple[Tensor, Tensor]:
        found = proposal_losses(
            ProposalMaps(list(values[:2]), list(values[2:])), anchors, match, trees
        )
        return found["objectness"], found["proposal_shift"]

    assert gradcheck(total, (*maps.logits, *maps.deltas))


def test_gradients_of_the_box_losses_are_right() -> None:
    boxes, truth = some_boxes(6, 1), some_boxes(6, 2)
    positive = torch.tensor([True, True, False, False, False, False])
    used = torch.tensor([True, True, True, True, False, False])

    def total(logits: Tensor, shifts: Tensor) -> tuple[Tensor, Tensor]:
        found = box_losses(logits, shifts, boxes, truth, positive, used)
        return found["score"], found["box_shift"]

    assert gradcheck(total, (noise(6, 2).requires_grad_(), noise(6, 4, seed=1).requires_grad_()))


def test_gradients_of_the_mask_and_keypoint_losses_are_right() -> None:
    wanted = (noise(3, 6, 6, seed=1) > 0).double()
    assert gradcheck(lambda x: mask_loss(x, wanted), (noise(3, 6, 6).requires_grad_(),))
    cells = torch.tensor([[3, 35, 0], [7, 7, 20]])
    inside = torch.tensor([[True, True, False], [False, True, True]])
    maps = noise(2, 3, 6, 6).requires_grad_()
    assert gradcheck(lambda x: keypoint_loss(x, cells, inside), (maps,))
    (gradient,) = torch.autograd.grad(keypoint_loss(maps, cells, inside), maps)
    assert not gradient[~inside].any()


def test_without_anything_to_learn_losses_are_zero_and_so_are_gradients() -> None:
    maps, anchors, match, trees = proposal_case()
    none = torch.zeros_like(match.positive)
    found = proposal_losses(maps, anchors, AnchorMatch(none, none, match.tree), trees)
    assert [float(value.detach()) for value in found.values()] == [0.0, 0.0]
    logits = noise(4, 2).requires_grad_()
    off = torch.zeros(4, dtype=torch.bool)
    boxes = box_losses(logits, noise(4, 4), some_boxes(4, 1), some_boxes(4, 2), off, off)
    assert [float(value.detach()) for value in boxes.values()] == [0.0, 0.0]
    (gradient,) = torch.autograd.grad(boxes["score"], logits)
    assert not gradient.any()
