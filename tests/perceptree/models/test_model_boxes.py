import math

import pytest
import torch
from torch import Tensor
from torchvision.models.detection._utils import BoxCoder
from torchvision.models.detection.anchor_utils import AnchorGenerator
from torchvision.models.detection.image_list import ImageList
from torchvision.ops import box_iou, nms, roi_align
from torchvision.ops.poolers import LevelMapper

from perceptree.models.anchors import level_anchors
from perceptree.models.boxes import (
    clip_boxes,
    decode_boxes,
    encode_boxes,
    enlarge_boxes,
    pairwise_iou,
    suppress,
)
from perceptree.models.roi_align import assign_levels, pool_regions, pool_regions_by_matrix


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
    order, real = suppress(boxes, scores, valid, 0.3, 50)
    assert order.shape == real.shape == (50,)
    assert order[real].tolist() == kept.tolist()
    order, real = suppress(boxes, scores, torch.zeros(60, dtype=torch.bool), 0.3, 5)
    assert not real.any()


def test_anchors_have_their_area_and_shape_and_are_centred_on_cells() -> None:
    anchors = level_anchors(3, 5, 16, 80.0, (2.0, 10.0)).reshape(3, 5, 2, 4)
    size = anchors[..., 2:] - anchors[..., :2]
    torch.testing.assert_close(size.prod(-1), torch.full((3, 5, 2), 6400.0))
    ratio = torch.tensor([2.0, 10.0])
    torch.testing.assert_close(size[..., 1] / size[..., 0], ratio.expand(3, 5, 2))
    centre = (anchors[2, 3, 0, :2] + anchors[2, 3, 0, 2:]) / 2
    assert centre.tolist() == pytest.approx([3.5 * 16, 2.5 * 16])


def test_anchor_order_is_torchvisions() -> None:
    # torchvision rounds its anchors and centres them on cells' corners.
    theirs = AnchorGenerator(((64,),), ((2.0, 4.0),))
    images = ImageList(torch.zeros(1, 3, 64, 96), [(64, 96)])
    expected = theirs(images, [torch.zeros(1, 8, 2, 3)])[0]
    ours = level_anchors(2, 3, 32, 64.0, (2.0, 4.0)) - 16
    assert (ours - expected).abs().max() < 0.51


def test_regions_go_to_the_level_that_torchvision_chooses() -> None:
    boxes = torch.cat((some_boxes(100, 5, 40.0), some_boxes(100, 6, 900.0)))
    expected = LevelMapper(3, 5)([boxes]) + 3
    assert assign_levels(boxes, (3, 4, 5)).tolist() == expected.tolist()
    assert set(expected.tolist()) == {3, 4, 5}
    exact = torch.tensor([[0.0, 0.0, 224.0, 224.0]])
    assert assign_levels(exact, (3, 4, 5)).item() == 4


def test_each_region_is_pooled_from_its_own_level() -> None:
    torch.manual_seed(0)
    maps = {
        3: torch.randn(2, 4, 48, 80),
        4: torch.randn(2, 4, 24, 40),
        5: torch.randn(2, 4, 12, 20),
    }
    boxes = torch.cat((some_boxes(10, 1, 60.0), some_boxes(10, 2, 900.0)))
    images = torch.arange(20) // 10
    ours = pool_regions(maps, boxes, images, (3, 4, 5), 7)
    levels = LevelMapper(3, 5)([boxes]) + 3
    for row, level in enumerate(levels.tolist()):
        region = torch.cat((images[row, None].float(), boxes[row]))[None]
        expected = roi_align(maps[level], region, 7, 2.0**-level, 2, aligned=True)[0]
        torch.testing.assert_close(ours[row], expected)


@pytest.mark.parametrize("cells", [7, 14])
def test_matrix_pooling_and_its_gradient_equal_the_operator(cells: int) -> None:
    torch.manual_seed(0)
    feature = torch.randn(2, 6, 24, 40, requires_grad=True)
    boxes = some_boxes(8) - 60  # some of them reach over the border
    boxes[0] = torch.tensor([600.0, 300.0, 900.0, 700.0])
    images = torch.tensor([0, 0, 0, 1, 1, 1, 1, 1])
    weight = torch.randn(8, 6, cells, cells)
    answers = []
    for pool in (pool_regions, pool_regions_by_matrix):
        feature.grad = None
        pooled = pool({4: feature}, boxes, images, (4,), cells)
        (pooled * weight).sum().backward()
        assert feature.grad is not None
        answers.append((pooled.detach(), feature.grad.clone()))
    torch.testing.assert_close(answers[0][0], answers[1][0], atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(answers[0][1], answers[1][1], atol=1e-4, rtol=1e-4)


def test_growth_is_capped_so_that_decoding_stays_finite() -> None:
    anchor = torch.tensor([[0.0, 0.0, 16.0, 16.0]])
    box = decode_boxes(torch.tensor([[0.0, 0.0, 1e4, 1e4]]), anchor, (1.0,) * 4)
    assert (box[0, 2] - box[0, 0]).item() == pytest.approx(1000.0, rel=1e-4)
    assert math.isfinite(box.sum().item())
