import math

import pytest
import torch
from torch import Tensor
from torchvision.models.detection._utils import BoxCoder
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.image_list import ImageList
from torchvision.ops import box_iou, nms
from torchvision.ops.poolers import LevelMapper

from perceptree.models import make_spec
from perceptree.models.anchors import level_anchors
from perceptree.models.boxes import (
    clip_boxes,
    decode_boxes,
    encode_boxes,
    enlarge_boxes,
    joint_nms_keep_mask,
    nms_keep_mask,
    nms_top_k,
    pairwise_iou,
    vote_boxes,
)
from perceptree.models.roi_align import assign_levels
from perceptree.models.rpn import ProposalNetwork


def some_boxes(count: int, seed: int = 0, size: float = 200.0) -> Tensor:
    random = torch.Generator().manual_seed(seed)
    corner = torch.rand(count, 2, generator=random) * 300
    return torch.cat((corner, corner + 4 + torch.rand(count, 2, generator=random) * size), dim=1)


def test_box_coding_equals_torchvision() -> None:
    weights = (10.0, 10.0, 5.0, 5.0)
    boxes, anchors = some_boxes(50, 1), some_boxes(50, 2)
    theirs = BoxCoder(weights)
    deltas = encode_boxes(boxes, anchors, weights)
    torch.testing.assert_close(deltas, theirs.encode_single(boxes, anchors))
    torch.testing.assert_close(decode_boxes(deltas, anchors, weights), boxes, atol=1e-3, rtol=0)
    wild = torch.randn(50, 4) * 40
    expected = theirs.decode_single(wild, anchors)
    torch.testing.assert_close(decode_boxes(wild, anchors, weights), expected, rtol=1e-4, atol=0.1)


def test_overlap_equals_torchvision_and_is_zero_for_empty_boxes() -> None:
    first, second = some_boxes(30, 1), some_boxes(40, 2)
    torch.testing.assert_close(pairwise_iou(first, second), box_iou(first, second))
    assert pairwise_iou(torch.zeros(2, 4), torch.zeros(3, 4)).tolist() == [[0.0] * 3] * 2


def test_clipping_and_enlarging() -> None:
    box = torch.tensor([[-5.0, 10.0, 700.0, 500.0]])
    assert clip_boxes(box, 384, 640).tolist() == [[0.0, 10.0, 640.0, 384.0]]
    assert enlarge_boxes(torch.tensor([[10.0, 20.0, 20.0, 60.0]]), 1.5).tolist() == [
        [7.5, 10.0, 22.5, 70.0]
    ]


def test_suppression_keeps_what_nms_keeps_in_a_fixed_number_of_rows() -> None:
    boxes, scores = some_boxes(60, 3), torch.rand(60, generator=torch.Generator().manual_seed(1))
    valid = torch.arange(60) % 3 > 0
    kept = torch.nonzero(valid)[:, 0][nms(boxes[valid], scores[valid], 0.3)]
    order, real = nms_top_k(boxes, scores, valid, 0.3, 50)
    assert order.shape == real.shape == (50,)
    assert order[real].tolist() == kept.tolist()
    order, real = nms_top_k(boxes, scores, torch.zeros(60, dtype=torch.bool), 0.3, 5)
    assert not real.any()


def test_anchors_have_their_area_and_shape_and_are_centred_on_cells() -> None:
    anchors = level_anchors(3, 5, 16, (80.0,), (2.0, 10.0)).reshape(3, 5, 2, 4)
    size = anchors[..., 2:] - anchors[..., :2]
    torch.testing.assert_close(size.prod(-1), torch.full((3, 5, 2), 6400.0))
    ratio = torch.tensor([2.0, 10.0])
    torch.testing.assert_close(size[..., 1] / size[..., 0], ratio.expand(3, 5, 2))
    centre = (anchors[2, 3, 0, :2] + anchors[2, 3, 0, 2:]) / 2
    assert centre.tolist() == pytest.approx([3.5 * 16, 2.5 * 16])


def test_anchors_are_torchvisions_but_for_its_rounding() -> None:
    sizes, ratios = ((32, 64), (64, 128)), (0.5, 1.0, 4.0)
    theirs = AnchorGenerator(sizes, (ratios,) * 2)
    images = ImageList(torch.zeros(1, 3, 64, 96), [(64, 96)])
    expected = theirs(images, [torch.zeros(1, 8, 4, 6), torch.zeros(1, 8, 2, 3)])[0]
    # Its order has ratios in the outer loop and sizes in the inner one.
    order = [0, 2, 4, 1, 3, 5]
    expected = expected.reshape(-1, 6, 4)[:, order].reshape(-1, 4)
    ours = torch.cat(
        [
            level_anchors(4, 6, 16, sizes[0], ratios, 0.0),
            level_anchors(2, 3, 32, sizes[1], ratios, 0.0),
        ]
    )
    assert ours.shape == expected.shape
    assert float((ours - expected).abs().max()) < 0.501


def test_anchors_are_detectron2s_in_its_order() -> None:
    """Of two cells with the ratios 1/4, 1 and 4, as its DefaultAnchorGenerator puts them."""
    first_cell = [
        *([-32.0, -8.0, 32.0, 8.0], [-16.0, -16.0, 16.0, 16.0], [-8.0, -32.0, 8.0, 32.0]),
        *([-64.0, -16.0, 64.0, 16.0], [-32.0, -32.0, 32.0, 32.0], [-16.0, -64.0, 16.0, 64.0]),
    ]
    right_cell = [[left + 4, top, right + 4, bottom] for left, top, right, bottom in first_cell]
    lower_row = [[left, top + 4, right, bottom + 4] for left, top, right, bottom in first_cell]
    ours = level_anchors(2, 2, 4, (32.0, 64.0), (0.25, 1.0, 4.0), 0.0).tolist()
    assert ours[:6] == first_cell
    assert ours[6:12] == right_cell
    assert ours[12:18] == lower_row
    assert len(ours) == 24


def test_the_paper_presets_anchors_are_detectron2s_on_every_level() -> None:
    # The input of 150x90 px is padded to 160x96 px: cells by level, and sides of squares, px.
    grids = {2: (24, 40, 32), 3: (12, 20, 64), 4: (6, 10, 128), 5: (3, 5, 256), 6: (2, 3, 512)}
    spec = make_spec("r50", "rgb", 90, 150)
    anchors = dict(zip(spec.levels, ProposalNetwork(spec).anchors(), strict=True))
    assert anchors.keys() == grids.keys()
    for level, (rows, columns, side) in grids.items():
        assert len(anchors[level]) == rows * columns * 3
        wide, square, tall = anchors[level][:3]
        torch.testing.assert_close(square, side / 2 * torch.tensor([-1.0, -1.0, 1.0, 1.0]))
        flat = side / 2**1.5 * torch.tensor([-2.0, -1.0, 2.0, 1.0])
        torch.testing.assert_close(wide, flat)
        torch.testing.assert_close(tall, flat[[1, 0, 3, 2]])
        step = 2.0**level
        last = torch.tensor([step * (columns - 1), step * (rows - 1)]).repeat(2)
        torch.testing.assert_close(anchors[level][-2], square + last)


@pytest.mark.parametrize("levels", [(3, 4, 5), (2, 3, 4, 5)])
def test_regions_go_to_the_level_that_torchvision_chooses(levels: tuple[int, ...]) -> None:
    boxes = torch.cat([some_boxes(100, seed, size) for seed, size in ((5, 40.0), (6, 900.0))])
    expected = LevelMapper(levels[0], levels[-1])([boxes]) + levels[0]
    assert assign_levels(boxes, levels).tolist() == expected.tolist()
    assert set(expected.tolist()) == set(levels)
    sides = torch.tensor([111.9, 112.0, 223.9, 224.0, 447.9, 448.0, 0.0])
    exact = torch.stack((0 * sides, 0 * sides, sides, sides), dim=1)
    wanted = [max(2, levels[0]), 3, 3, 4, 4, 5, levels[0]]
    assert assign_levels(exact, levels).tolist() == wanted


def test_growth_is_capped_so_that_decoding_stays_finite() -> None:
    anchor = torch.tensor([[0.0, 0.0, 16.0, 16.0]])
    box = decode_boxes(torch.tensor([[0.0, 0.0, 1e4, 1e4]]), anchor, (1.0,) * 4)
    assert (box[0, 2] - box[0, 0]).item() == pytest.approx(1000.0, rel=1e-4)
    assert math.isfinite(box.sum().item())


def test_one_call_for_all_images_keeps_what_a_call_for_each_keeps() -> None:
    generator = torch.Generator().manual_seed(5)
    corner = torch.rand(3, 60, 2, generator=generator) * 200
    boxes = torch.cat((corner, corner + torch.rand(3, 60, 2, generator=generator) * 120), dim=-1)
    scores = torch.rand(3, 60, generator=generator)
    valid = torch.rand(3, 60, generator=generator) > 0.2
    kept = joint_nms_keep_mask(boxes, scores, valid, 0.3)
    each = [nms_keep_mask(boxes[i], scores[i], valid[i], 0.3) for i in range(3)]
    assert torch.equal(kept, torch.stack(each))
    assert 0 < int(kept.sum()) < int(valid.sum())


def test_a_box_is_averaged_over_those_that_it_suppresses() -> None:
    boxes = torch.tensor(
        [[0.0, 0.0, 10.0, 100.0], [0.0, 10.0, 10.0, 90.0], [0.0, 0.0, 10.0, 40.0], [50, 0, 60, 99]]
    )
    scores = torch.tensor([0.8, 0.6, 0.9, 0.7])
    # Overlaps of the first with all: 1, 0.8, 0.4 and 0; beyond 0.5: 0.5, 0.3, 0 and 0.
    voted = vote_boxes(boxes[[0, 3]], boxes, scores, 0.5)
    low, high = (0.6 * 0.3 * 10) / 0.58, (0.8 * 0.5 * 100 + 0.6 * 0.3 * 90) / 0.58
    torch.testing.assert_close(voted[0], torch.tensor([0.0, low, 10.0, high]))
    torch.testing.assert_close(voted[1], boxes[3])


def test_boxes_without_a_score_have_no_vote() -> None:
    boxes = torch.tensor([[0.0, 0.0, 10.0, 100.0], [0.0, 10.0, 10.0, 90.0]])
    alone = vote_boxes(boxes[:1], boxes, torch.tensor([0.9, 0.0]), 0.5)
    torch.testing.assert_close(alone, boxes[:1])
    assert torch.equal(vote_boxes(boxes, boxes, torch.zeros(2), 0.5), boxes)
    assert torch.equal(vote_boxes(torch.zeros(3, 4), boxes, torch.ones(2), 0.5), torch.zeros(3, 4))
