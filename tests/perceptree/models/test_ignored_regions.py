"""Ignored regions in matching and losses, against values computed one box at a time."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from perceptree.models import SampleSettings, TreeRCNN, make_spec
from perceptree.models.losses import box_losses, proposal_losses
from perceptree.models.matching import match_anchors, sample_regions
from perceptree.models.rpn import ProposalMaps
from perceptree.models.targets import PaddedBoxes, TreeTargets, pad_boxes
from perceptree.training.batches import SeededDraws

TREE = [0.0, 0.0, 10.0, 10.0]
IGNORED = [100.0, 0.0, 140.0, 100.0]
# Share of the own area inside the ignored region, and IoU with it.
BOXES = {
    "tree": TREE,
    "inside": [100.0, 0.0, 120.0, 40.0],  # 1, 0.2
    "half inside": [130.0, 0.0, 150.0, 40.0],  # 0.5, 0.09
    "less inside": [131.0, 0.0, 151.0, 40.0],  # 0.45, 0.08
    "around": [60.0, 0.0, 160.0, 100.0],  # 0.4, 0.4
    "far around": [40.0, 0.0, 240.0, 100.0],  # 0.2, 0.2
    "elsewhere": [300.0, 0.0, 310.0, 10.0],  # 0, 0
}
NAMES = list(BOXES)


def targets(boxes: list[list[float]], ignored: list[list[float]]) -> TreeTargets:
    return TreeTargets(
        torch.tensor(boxes).reshape(-1, 4),
        torch.zeros(len(boxes), 5, 3),
        None,
        torch.tensor(ignored).reshape(-1, 4),
    )


def trees(*images: tuple[list[list[float]], list[list[float]]]) -> PaddedBoxes:
    return pad_boxes([targets(*image) for image in images], torch.device("cpu"))


def softplus(value: float) -> float:
    return math.log1p(math.exp(value))


def named(flags: Tensor) -> set[str]:
    return {name for name, flag in zip(NAMES, flags.tolist(), strict=True) if flag}


def test_anchors_on_an_ignored_region_add_nothing_to_the_losses() -> None:
    anchors = torch.tensor(list(BOXES.values()))
    batch = trees(([TREE], [IGNORED]), ([TREE], []))
    match = match_anchors(anchors, batch, SampleSettings())
    assert [named(row) for row in match.positive] == [{"tree"}] * 2
    negative = {"less inside", "far around", "elsewhere"}
    assert named(match.negative[0]) == negative
    assert named(match.negative[1]) == set(NAMES) - {"tree"}
    logits = [[0.5, 3.0, -1.0, 0.7, 2.0, -0.4, 0.1], [1.5, 0.3, -2.0, 0.2, 1.0, -0.6, 0.9]]
    deltas = torch.zeros(2, len(NAMES), 4)
    deltas[:, 0] = torch.tensor([0.1, -0.2, 0.3, 0.4])  # of the tree, whose offsets are 0
    deltas[:, 1] = 9.0
    found = proposal_losses(ProposalMaps([torch.tensor(logits)], [deltas]), anchors, match, batch)
    first = softplus(-0.5) + softplus(0.7) + softplus(-0.4) + softplus(0.1)
    second = softplus(-1.5) + sum(map(softplus, (0.3, -2.0, 0.2, 1.0, -0.6, 0.9)))
    count = 4 + 7
    assert float(found["objectness"]) == pytest.approx((first + second) / count, rel=1e-6)
    assert float(found["proposal_shift"]) == pytest.approx(2 * 1.0 / count, rel=1e-6)


def test_proposals_on_an_ignored_region_add_nothing_to_the_losses() -> None:
    proposals = torch.tensor([list(BOXES.values())])
    valid = torch.ones(1, len(NAMES), dtype=torch.bool)
    # An overlap of 0.4 is enough to be a tree here, and so to be no background.
    settings = SampleSettings(region_positive_iou=0.4)
    batch = trees(([TREE], [IGNORED]))
    sample = sample_regions(proposals, valid, batch, settings)
    used = {tuple(box) for box in sample.boxes[0][sample.used[0]].tolist()}
    expected = ("tree", "less inside", "far around", "elsewhere")
    assert used == {tuple(BOXES[name]) for name in expected}
    assert int(sample.used.sum()) == 5  # the true box is a region, too
    assert int(sample.positive.sum()) == 2
    boxes = sample.boxes[0]
    score = boxes[:, 0] / 100  # one logit per region, known from its box
    logits = torch.stack([score, -score], dim=1)
    truth = batch.boxes[0].expand(len(boxes), -1)
    flags = sample.positive[0], sample.used[0]
    found = box_losses(logits, torch.zeros(len(boxes), 4), boxes, truth, *flags)
    lefts = [BOXES[name][0] / 100 for name in expected[1:]]
    by_hand = (2 * softplus(0.0) + sum(softplus(2 * left) for left in lefts)) / 5
    assert float(found["score"]) == pytest.approx(by_hand, rel=1e-6)
    usual = sample_regions(proposals, valid, batch, SampleSettings())
    kept = {tuple(box) for box in usual.boxes[0][usual.used[0]].tolist()}
    assert kept == used | {tuple(BOXES["around"])}


def test_ignored_proposals_take_no_places_of_the_sample() -> None:
    many = torch.tensor([[IGNORED] * 60 + [BOXES["elsewhere"]] * 4])
    valid = torch.ones(1, 64, dtype=torch.bool)
    sample = sample_regions(many, valid, trees(([TREE], [IGNORED])), SampleSettings(regions=5))
    assert sample.used.all()
    assert sample.positive.tolist() == [[True, False, False, False, False]]
    assert sample.boxes[0, 1:].tolist() == [BOXES["elsewhere"]] * 4


def test_a_tree_that_counts_stays_positive_inside_an_ignored_region() -> None:
    inside = BOXES["inside"]
    batch = trees(([inside], [IGNORED]))
    match = match_anchors(torch.tensor([inside, IGNORED]), batch, SampleSettings())
    assert match.positive.tolist() == [[True, False]]
    assert not match.negative.any()
    valid = torch.ones(1, 1, dtype=torch.bool)
    sample = sample_regions(torch.tensor([[inside]]), valid, batch, SampleSettings())
    assert sample.positive.all()


def test_ignored_regions_change_no_random_number() -> None:
    random = torch.Generator().manual_seed(5)
    corner = 300 * torch.rand(2, 400, 2, generator=random)
    boxes = torch.cat((corner, corner + 20), dim=-1)
    near = [[10.0, 10, 30, 30]], [[150.0, 150, 170, 170]]
    without, aside, on = (
        trees(*((found, ignored) for found in near))
        for ignored in ([], [[900.0, 900, 950, 950]], [[0.0, 0, 60, 60]])
    )
    assert without.ignored is None
    settings = SampleSettings(anchors=40, regions=20)
    valid = torch.ones(2, 400, dtype=torch.bool)
    matches, samples = [], []
    for batch in (without, aside, on):
        draw = SeededDraws([7, 8])
        matches.append(match_anchors(boxes[0], batch, settings, draw))
        samples.append(sample_regions(boxes, valid, batch, settings, draw))
    for first, second in ((matches[0], matches[1]), (samples[0], samples[1])):
        assert all(torch.equal(one, two) for one, two in zip(first, second, strict=True))
    assert torch.equal(matches[0].positive, matches[2].positive)
    assert not torch.equal(matches[0].negative, matches[2].negative)


def test_an_image_that_is_ignored_as_a_whole_adds_nothing() -> None:
    torch.manual_seed(0)
    model = TreeRCNN(make_spec("edge-n", "depth", 64, 96, fpn_width=16, masks=False)).eval()
    images = torch.randint(0, 255, (2, 64, 96), dtype=torch.uint8)
    seen = targets([[20.0, 5, 40, 60]], [])
    whole = targets([], [[-999.0, -999, 999, 999]])
    alone = model.losses(images[:1], [seen], draw=SeededDraws([1]))
    both = model.losses(images, [seen, whole], draw=SeededDraws([1, 2]))
    as_background = model.losses(images, [seen, targets([], [])], draw=SeededDraws([1, 2]))
    for name, value in alone.items():
        assert float(both[name].detach()) == pytest.approx(float(value.detach()), rel=1e-4)
    assert float(as_background["score"].detach()) != pytest.approx(float(alone["score"].detach()))


def test_ignored_regions_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match=r"ignored have shape \(3, 5\), expected \(M, 4\)"):
        TreeTargets(torch.zeros(0, 4), torch.zeros(0, 5, 3), None, torch.zeros(3, 5))
