"""Selection of proposals: per level, then the best of all levels."""

import torch
from torch import Tensor
from torchvision.ops import nms

from perceptree.models import ModelSpec, make_spec
from perceptree.models.boxes import encode_boxes
from perceptree.models.rpn import PROPOSAL_WEIGHTS, ProposalMaps, ProposalNetwork

LEVELS = (3, 4, 5)


def network(**changes: object) -> ProposalNetwork:
    spec: ModelSpec = make_spec("edge-n", "rgb", 96, 160, fpn_width=8, **changes)
    return ProposalNetwork(spec)


def silent(proposer: ProposalNetwork, images: int = 1) -> ProposalMaps:
    """All anchors without offsets and with an objectness of -50."""
    anchors = proposer.anchors()
    return ProposalMaps(
        [torch.full((images, len(a)), -50.0) for a in anchors],
        [torch.zeros(images, len(a), 4) for a in anchors],
    )


def put(
    proposer: ProposalNetwork,
    maps: ProposalMaps,
    level: int,
    row: int,
    box: list[float],
    score: float,
) -> None:
    index = LEVELS.index(level)
    anchor = proposer.anchors()[index][row]
    maps.logits[index][0, row] = score
    maps.deltas[index][0, row] = encode_boxes(torch.tensor(box), anchor, PROPOSAL_WEIGHTS)


def test_boxes_are_suppressed_within_their_own_level_only() -> None:
    proposer = network()
    maps = silent(proposer)
    box = [40.0, 10.0, 60.0, 80.0]
    put(proposer, maps, 3, 100, box, 5.0)
    put(proposer, maps, 3, 101, [40.0, 10.0, 60.0, 78.0], 4.0)
    put(proposer, maps, 5, 20, box, 3.0)
    put(proposer, maps, 4, 30, [100.0, 10.0, 130.0, 80.0], 2.0)
    found = proposer.propose(maps, 50, 20)
    kept = [b.tolist() for b, s in zip(found.boxes[0], found.scores[0], strict=True) if s > -50]
    torch.testing.assert_close(
        torch.tensor(kept), torch.tensor([box, box, [100.0, 10.0, 130.0, 80.0]]), atol=1e-3, rtol=0
    )
    assert found.scores[0, :3].tolist() == [5.0, 3.0, 2.0]


def expected_proposals(
    proposer: ProposalNetwork, maps: ProposalMaps, image: int, per_level: int, count: int
) -> tuple[Tensor, Tensor]:
    """Boxes and scores by torchvision's NMS, image by image."""
    boxes, scores = [], []
    for anchors, logits, deltas in zip(proposer.anchors(), *maps, strict=True):
        order = logits[image].argsort(descending=True, stable=True)[:per_level]
        size = anchors[order, 2:] - anchors[order, :2]
        centre = (anchors[order, :2] + anchors[order, 2:]) / 2 + deltas[image, order, :2] * size
        half = size * deltas[image, order, 2:].exp() / 2
        box = torch.cat((centre - half, centre + half), dim=1)
        box[:, 0::2] = box[:, 0::2].clamp(0, proposer.spec.width)
        box[:, 1::2] = box[:, 1::2].clamp(0, proposer.spec.height)
        score = logits[image, order]
        real = ((box[:, 2:] - box[:, :2]) > 0).all(dim=1)
        box, score = box[real], score[real]
        kept = nms(box, score, proposer.spec.proposal_nms_iou)
        boxes.append(box[kept])
        scores.append(score[kept])
    every = torch.cat(scores)
    best = every.argsort(descending=True, stable=True)[:count]
    return torch.cat(boxes)[best], every[best]


def test_the_best_of_each_level_and_then_of_all_are_kept() -> None:
    proposer = network(proposal_nms_iou=0.5)
    random = torch.Generator().manual_seed(0)
    anchors = proposer.anchors()
    maps = ProposalMaps(
        [3 * torch.randn(2, len(a), generator=random) for a in anchors],
        [0.3 * torch.randn(2, len(a), 4, generator=random) for a in anchors],
    )
    for per_level, count in ((60, 40), (30, 500), (10_000, 100)):
        found = proposer.propose(maps, per_level, count)
        for image in range(2):
            boxes, scores = expected_proposals(proposer, maps, image, per_level, count)
            real = int(found.valid[image].sum())
            assert real == len(boxes)
            torch.testing.assert_close(found.scores[image, :real], scores)
            torch.testing.assert_close(found.boxes[image, :real], boxes, atol=1e-3, rtol=1e-5)
            assert not found.valid[image, real:].any()
            assert not found.boxes[image, real:].any()
            assert not found.scores[image, real:].any()
    assert len(expected_proposals(proposer, maps, 0, 30, 500)[0]) < 90


def test_proposals_outside_the_image_are_cut_or_left_out() -> None:
    proposer = network()
    maps = silent(proposer)
    put(proposer, maps, 3, 7, [-30.0, -20.0, 20.0, 40.0], 5.0)
    put(proposer, maps, 4, 7, [200.0, 10.0, 300.0, 60.0], 9.0)
    found = proposer.propose(maps, 50, 20)
    torch.testing.assert_close(
        found.boxes[0, 0], torch.tensor([0.0, 0.0, 20.0, 40.0]), atol=1e-3, rtol=0
    )
    assert found.scores[0, 0] == 5.0
    assert found.boxes[found.valid].min() >= 0
    assert found.boxes[found.valid][:, 2].max() <= 160
    assert found.boxes[found.valid][:, 3].max() <= 96


def test_maps_become_one_row_for_each_anchor_in_the_anchors_order() -> None:
    proposer = network()
    with torch.no_grad():
        proposer.conv.weight.zero_()
        proposer.conv.bias.fill_(1.0)
        proposer.objectness.weight.zero_()
        proposer.objectness.bias.copy_(torch.arange(3.0))
        proposer.shift.weight.zero_()
        proposer.shift.bias.copy_(torch.arange(12.0))
    maps = proposer([torch.randn(2, 8, *proposer.spec.map_size(n)) for n in LEVELS])
    for anchors, logits, deltas in zip(proposer.anchors(), *maps, strict=True):
        assert logits.shape == (2, len(anchors))
        assert deltas.shape == (2, len(anchors), 4)
        cells = len(anchors) // 3
        assert logits[1].reshape(cells, 3).tolist() == [[0.0, 1.0, 2.0]] * cells
        assert deltas[1].reshape(cells, 3, 4)[-1].flatten().tolist() == list(range(12))
