import math

import numpy as np
import pytest
import torch
from torch import Tensor
from torchvision.models.detection.roi_heads import keypoints_to_heatmap, project_masks_on_boxes
from torchvision.ops import roi_align

from basetree.errors import InputError
from perceptree.models import PAPER_SAMPLING, SampleSettings, TreeTargets
from perceptree.models.losses import (
    keypoint_loss,
    keypoint_targets,
    mask_loss,
    mask_targets,
)
from perceptree.models.matching import match_anchors, sample_regions
from perceptree.models.targets import PaddedBoxes, pad_boxes

S = 56


def test_keypoint_cells_equal_torchvisions() -> None:
    torch.manual_seed(0)
    boxes = torch.tensor([[10.0, 20.0, 50.0, 200.0], [0.0, 0.0, 30.0, 30.0]])
    xy = torch.rand(2, 5, 2) * 240 - 20
    flags = torch.tensor([[2.0, 1.0, 0.0, 2.0, 2.0]] * 2)
    keypoints = torch.cat((xy, flags[..., None]), dim=-1)
    keypoints[0, 0, :2] = torch.tensor([50.0, 200.0])  # the corner belongs to the last cell
    keypoints[1, 0, :2] = torch.tensor([15.0, 7.0])
    cells, inside = keypoint_targets(boxes, keypoints)
    expected, valid = keypoints_to_heatmap(keypoints, boxes, S)
    assert inside.tolist() == valid.bool().tolist()
    assert inside[0, 0]
    assert cells[inside].tolist() == expected[inside].tolist()
    assert cells[0, 0].item() == S * S - 1


def test_keypoint_loss_is_the_mean_entropy_of_those_inside() -> None:
    maps = torch.zeros(2, 5, S, S)
    inside = torch.tensor([[True, False, False, False, True], [False] * 5])
    cells = torch.zeros(2, 5, dtype=torch.long)
    assert keypoint_loss(maps, cells, inside).item() == pytest.approx(math.log(S * S), rel=1e-5)
    assert keypoint_loss(maps, cells, torch.zeros_like(inside)).item() == 0.0
    assert mask_loss(torch.zeros(0, 28, 28), torch.zeros(0, 28, 28)).item() == 0.0


def test_mask_cells_take_the_pixel_under_their_centre() -> None:
    masks = torch.zeros(2, 100, 100, dtype=torch.bool)
    masks[1, 20:60, 10:24] = True
    # Cells 1 px wide and 2 px high; their centres lie at 11.1, 12.1, ... and 21, 23, ...
    box = torch.tensor([[10.6, 20.0, 38.6, 76.0]])
    wanted = mask_targets(box, masks, torch.tensor([1]))[0]
    expected = torch.zeros(28, 28)
    expected[:20, :13] = 1
    assert wanted.tolist() == expected.tolist()


def ellipses(count: int) -> Tensor:
    """(N, 300, 400) bool masks with different centres, sizes and leans."""
    random = np.random.default_rng(0)
    y, x = np.mgrid[:300, :400] + 0.5
    masks = []
    for _ in range(count):
        dx, dy = x - random.uniform(150, 250), y - random.uniform(100, 200)
        dx = dx + random.uniform(-0.4, 0.4) * dy
        masks.append((dx / random.uniform(20, 90)) ** 2 + (dy / random.uniform(30, 90)) ** 2 < 1)
    return torch.from_numpy(np.stack(masks))


def boxes_around(masks: Tensor) -> Tensor:
    """Loose and tight boxes with fractional coordinates."""
    random = torch.Generator().manual_seed(1)
    boxes = []
    for mask in masks:
        row, column = mask.nonzero(as_tuple=True)
        low, high = torch.stack((column, row)).amin(1), torch.stack((column, row)).amax(1) + 1
        boxes.append(torch.cat((low, high)) + 20 * torch.rand(4, generator=random) - 10)
    return torch.stack(boxes)


def test_mask_targets_are_torchvisions_but_for_cells_on_the_outline() -> None:
    masks = ellipses(40)
    boxes = boxes_around(masks)
    tree = torch.arange(40)
    ours = mask_targets(boxes, masks, tree)
    # torchvision's fraction of each cell, shifted by half a pixel, as it pools without alignment.
    share = project_masks_on_boxes(masks, boxes, tree, 28)
    clear = (share < 0.02) | (share > 0.98)
    assert float(clear.float().mean()) > 0.8
    assert ours.shape == share.shape
    assert torch.equal(ours[clear], share[clear].round())
    assert float((ours - share).abs().mean()) < 0.04
    assert float((ours.mean(dim=(1, 2)) - share.mean(dim=(1, 2))).abs().max()) < 0.02
    # Detectron2's targets: aligned, with a threshold of 0.5.
    regions = torch.cat((tree[:, None].float(), boxes), dim=1)
    aligned = roi_align(masks[:, None].float(), regions, 28, 1.0, 0, aligned=True)[:, 0] >= 0.5
    assert float((ours.bool() != aligned).float().mean()) < 0.02


def targets(boxes: list[list[float]]) -> TreeTargets:
    count = len(boxes)
    return TreeTargets(
        torch.tensor(boxes).reshape(-1, 4),
        torch.zeros(count, 5, 3),
        torch.zeros(count, 4, 4, dtype=torch.bool),
    )


def test_anchors_are_matched_by_overlap_and_every_tree_has_one() -> None:
    anchors = torch.tensor(
        [[0.0, 0, 10, 10], [0, 0, 10, 14], [100, 0, 110, 10], [300, 300, 310, 310]]
    )
    trees = pad_boxes([targets([[0, 0, 10, 10], [104, 0, 118, 10]]), targets([])], anchors.device)
    match = match_anchors(anchors, trees, SampleSettings())
    assert match.positive.tolist() == [[True, True, True, False], [False] * 4]
    assert match.tree[0, :3].tolist() == [0, 0, 1]
    assert match.negative.tolist() == [[False, False, False, True], [True] * 4]


def test_half_of_the_sampled_anchors_are_positive_at_most() -> None:
    anchors = torch.tensor([[0.0, 0, 10, 10]]).repeat(500, 1)
    anchors[200:] += 500
    trees = pad_boxes([targets([[0, 0, 10, 10]])], anchors.device)
    for settings, positives in (
        (SampleSettings(), 64),
        (PAPER_SAMPLING, 128),
        (SampleSettings(anchors=100, anchor_positive_share=0.2), 20),
    ):
        match = match_anchors(anchors, trees, settings)
        assert int(match.positive.sum()) == positives
        assert int(match.negative.sum()) == settings.anchors - positives
        assert not match.positive[0, 200:].any()


def test_overlaps_between_the_two_limits_are_not_learned_from() -> None:
    # Overlaps of 0.6, 0.35 and 0.2 with the only tree; its best anchor has 1.
    anchors = torch.tensor([[0.0, 0, 10, h] for h in (10, 6, 3.5, 2)])
    trees = pad_boxes([targets([[0, 0, 10, 10]])], anchors.device)
    ours = match_anchors(anchors, trees, SampleSettings())
    assert ours.positive.tolist() == [[True, True, False, False]]
    assert ours.negative.tolist() == [[False, False, False, True]]
    paper = match_anchors(anchors, trees, PAPER_SAMPLING)
    assert paper.positive.tolist() == [[True, False, False, False]]
    assert paper.negative.tolist() == [[False, False, False, True]]


def test_regions_hold_true_boxes_first_and_never_filling() -> None:
    torch.manual_seed(0)
    trees = PaddedBoxes(
        torch.tensor([[[0.0, 0, 50, 100], [200, 0, 250, 100]], [[0.0] * 4] * 2]),
        torch.tensor([[True, True], [False, False]]),
    )
    proposals = torch.rand(2, 80, 2) * 100 + 300
    proposals = torch.cat((proposals, proposals + 30), dim=-1)
    valid = torch.ones(2, 80, dtype=torch.bool)
    valid[1, 10:] = False
    sample = sample_regions(proposals, valid, trees, SampleSettings())
    assert sample.positive[0, :2].all()
    assert int(sample.positive.sum()) == 2
    boxes = sorted(sample.boxes[0, :2].tolist())
    assert boxes == trees.boxes[0].tolist()
    assert int(sample.used[0].sum()) == 64
    assert int(sample.used[1].sum()) == 10
    assert sample.tree[0, :2].sort().values.tolist() == [0, 1]


def test_a_quarter_of_the_papers_regions_are_positive_at_most() -> None:
    tree = torch.tensor([[[100.0, 100, 200, 300]]])
    near = tree + torch.rand(1, 400, 4) * 4
    far = tree + 500 + torch.rand(1, 400, 4)
    boxes = torch.cat((near, far), dim=1)
    valid = torch.ones(1, 800, dtype=torch.bool)
    sample = sample_regions(boxes, valid, PaddedBoxes(tree, valid[:, :1]), PAPER_SAMPLING)
    assert sample.boxes.shape == (1, 256, 4)
    assert int(sample.positive.sum()) == 64
    assert sample.positive[0, :64].all()
    assert sample.used.all()
    assert (sample.boxes[0, 64:, 0] > 500).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"regions": 0}, "regions is 0: expected at least 1"),
        ({"region_positive_share": 0.0}, "region_positive_share is 0.0: expected over 0"),
        ({"anchor_positive_iou": 1.5}, "anchor_positive_iou is 1.5: expected over 0, at most 1"),
        (
            {"anchor_negative_iou": 0.6},
            r"anchor_negative_iou is 0.6: expected 0 to anchor_positive_iou \(0.5\)",
        ),
    ],
)
def test_sampling_that_makes_no_sense_is_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        SampleSettings(**changes)  # type: ignore[arg-type]


def test_targets_refuse_shapes_that_do_not_belong_together() -> None:
    with pytest.raises(ValueError, match=r"keypoints have shape \(3, 5, 3\), expected \(2, 5, 3\)"):
        TreeTargets(torch.zeros(2, 4), torch.zeros(3, 5, 3), torch.zeros(2, 4, 4).bool())
    with pytest.raises(ValueError, match=r"masks are torch\.float32, expected bool"):
        TreeTargets(torch.zeros(2, 4), torch.zeros(2, 5, 3), torch.zeros(2, 4, 4))
