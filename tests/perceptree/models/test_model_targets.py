import math

import numpy as np
import pytest
import torch
from torch.nn import functional
from torchvision.models.detection.roi_heads import keypoints_to_heatmap

from perceptree.models import TreeTargets
from perceptree.models.decode import decode_keypoints, refine_matrix
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
    keypoints[0, 0, :2] = torch.tensor([50.0, 200.0])  # the very corner: the last cell
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


def brute_force_peak(maps: torch.Tensor, factor: int) -> tuple[float, float, float]:
    """x, y in cells and logit of the highest point of torch's own bicubic surface."""
    fine = functional.interpolate(
        maps[None, None], scale_factor=factor, mode="bicubic", align_corners=False
    )[0, 0]
    best = int(fine.argmax())
    row, column = divmod(best, fine.shape[1])
    return (column + 0.5) / factor, (row + 0.5) / factor, float(fine.max())


def test_keypoints_lie_on_the_peak_of_the_bicubic_surface() -> None:
    random = np.random.default_rng(0)
    grid = torch.arange(S) + 0.5
    worst, scores = [], []
    for _ in range(40):
        x, y, width = random.uniform(1, S - 1), random.uniform(1, S - 1), random.uniform(1.0, 4.0)
        bump = -((grid[None, :] - x) ** 2 + (grid[:, None] - y) ** 2) / width
        maps = (bump + 0.05 * torch.randn(S, S)).float()
        found = decode_keypoints(
            maps[None, None], torch.tensor([[0.0, 0.0, S, S]]), refine_matrix()
        )[0, 0]
        x, y, peak = brute_force_peak(maps, 32)
        worst.append(max(abs(found[0].item() - x), abs(found[1].item() - y)))
        expected = 1.0 / torch.exp(maps - peak).sum().item()
        scores.append(abs(found[2].item() - expected) / expected)
    assert np.quantile(worst, 0.95) < 0.1
    assert max(scores) < 0.02


def test_keypoints_scale_with_their_box_and_stay_in_order() -> None:
    maps = torch.full((2, 5, S, S), -20.0)
    for keypoint in range(5):
        maps[:, keypoint, 10 + keypoint, 40] = 5.0
    boxes = torch.tensor([[100.0, 50.0, 156.0, 162.0], [0.0, 0.0, 5.6, 5.6]])
    found = decode_keypoints(maps, boxes, refine_matrix())
    assert found[0, :, 0].tolist() == pytest.approx([140.5] * 5, abs=1e-3)
    assert found[0, :, 1].tolist() == pytest.approx(
        [50 + 2 * (10.5 + k) for k in range(5)], abs=1e-3
    )
    assert found[1, :, 0].tolist() == pytest.approx([4.05] * 5, abs=1e-4)


def targets(boxes: list[list[float]]) -> TreeTargets:
    count = len(boxes)
    return TreeTargets(
        torch.tensor(boxes).reshape(-1, 4), torch.zeros(count, 5, 3),
        torch.zeros(count, 4, 4, dtype=torch.bool),
    )  # fmt: skip


def test_anchors_are_matched_by_overlap_and_every_tree_has_one() -> None:
    anchors = torch.tensor(
        [[0.0, 0, 10, 10], [0, 0, 10, 14], [100, 0, 110, 10], [300, 300, 310, 310]]
    )
    trees = pad_boxes([targets([[0, 0, 10, 10], [104, 0, 118, 10]]), targets([])], anchors.device)
    match = match_anchors(anchors, trees)
    assert match.positive.tolist() == [[True, True, True, False], [False] * 4]
    assert match.tree[0, :3].tolist() == [0, 0, 1]
    assert match.negative.tolist() == [[False, False, False, True], [True] * 4]


def test_half_of_the_sampled_anchors_are_positive_at_most() -> None:
    anchors = torch.tensor([[0.0, 0, 10, 10]]).repeat(500, 1)
    anchors[200:] += 500
    match = match_anchors(anchors, pad_boxes([targets([[0, 0, 10, 10]])], anchors.device))
    assert int(match.positive.sum()) == 64
    assert int(match.negative.sum()) == 64
    assert not match.positive[0, 200:].any()


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
    sample = sample_regions(proposals, valid, trees)
    assert sample.positive[0, :2].all()
    assert int(sample.positive.sum()) == 2
    boxes = sorted(sample.boxes[0, :2].tolist())
    assert boxes == trees.boxes[0].tolist()
    assert int(sample.used[0].sum()) == 64
    assert int(sample.used[1].sum()) == 10
    assert sample.tree[0, :2].sort().values.tolist() == [0, 1]


def test_targets_refuse_shapes_that_do_not_belong_together() -> None:
    with pytest.raises(ValueError, match=r"keypoints have shape \(3, 5, 3\), expected \(2, 5, 3\)"):
        TreeTargets(torch.zeros(2, 4), torch.zeros(3, 5, 3), torch.zeros(2, 4, 4).bool())
    with pytest.raises(ValueError, match=r"masks are torch\.float32, expected bool"):
        TreeTargets(torch.zeros(2, 4), torch.zeros(2, 5, 3), torch.zeros(2, 4, 4))
