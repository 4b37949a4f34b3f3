"""The region proposal network (Ren et al. 2015, Faster R-CNN) on a feature pyramid."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from perceptree.models.anchors import level_anchors
from perceptree.models.boxes import clip_boxes, decode_boxes, joint_nms_keep_mask, nms_keep_mask
from perceptree.models.spec import ModelSpec

PROPOSAL_WEIGHTS = (1.0, 1.0, 1.0, 1.0)

SEPARABLE_SIDE = 5
"""Taps of the separable convolution each way."""


class ProposalMaps(NamedTuple):
    """The network's output for every anchor, one tensor per level."""

    logits: list[Tensor]
    """(B, A_level) float32 objectness logits, in the order of the anchors."""
    deltas: list[Tensor]
    """(B, A_level, 4) float32 box offsets."""


class Proposals(NamedTuple):
    """Candidate boxes of a batch, a fixed number per image, by descending objectness."""

    boxes: Tensor
    """(B, P, 4) xyxy px, clipped to the image; zero where not valid."""
    scores: Tensor
    """(B, P) objectness logits; zero where not valid."""
    valid: Tensor
    """(B, P) bool; false for padding."""


class ProposalNetwork(nn.Module):
    """A convolutional head that is shared by all levels, and the selection of proposals.

    Args:
        spec: Levels, anchors and widths.
    """

    def __init__(self, spec: ModelSpec) -> None:
        super().__init__()
        self.spec = spec
        anchors = spec.anchors_per_cell
        self.conv = _convolution(spec)
        self.objectness = nn.Conv2d(spec.fpn_width, anchors, 1)
        self.shift = nn.Conv2d(spec.fpn_width, 4 * anchors, 1)
        layers = [part for part in self.conv.modules() if isinstance(part, nn.Conv2d)]
        for layer in layers:
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
        for layer in (self.objectness, self.shift):
            nn.init.normal_(layer.weight, std=0.01)
        for layer in (layers[-1], self.objectness, self.shift):
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        for level, sizes_px in zip(spec.levels, spec.anchor_sizes_px, strict=True):
            boxes = level_anchors(
                *spec.map_size(level), 2**level, sizes_px, spec.anchor_ratios, spec.anchor_offset
            )
            self.register_buffer(f"anchors_{level}", boxes, persistent=False)

    def anchors(self) -> list[Tensor]:
        """The anchors (A_level, 4) xyxy px of every level."""
        return [self.get_buffer(f"anchors_{level}") for level in self.spec.levels]

    def forward(self, maps: list[Tensor]) -> ProposalMaps:
        """Compute objectness and box offsets of every anchor from pyramid maps (B, C, h, w)."""
        logits, deltas = [], []
        for x in maps:
            hidden = functional.relu(self.conv(x), inplace=True)
            batch = hidden.shape[0]
            logits.append(self.objectness(hidden).permute(0, 2, 3, 1).reshape(batch, -1).float())
            shift = self.shift(hidden).permute(0, 2, 3, 1)
            deltas.append(shift.reshape(batch, -1, 4).float())
        return ProposalMaps(logits, deltas)

    def propose(self, maps: ProposalMaps, per_level: int, count: int) -> Proposals:
        """Select proposals: decode the best anchors of each level and apply NMS per level.

        Args:
            maps: Output of the network.
            per_level: Anchors per level that are decoded.
            count: Proposals per image to return, the best of all levels.
        """
        levels = []
        for anchors, logits, deltas in zip(self.anchors(), *maps, strict=True):
            best = torch.topk(logits, min(per_level, logits.shape[1]))
            rows = best.indices[..., None].expand(-1, -1, 4)
            chosen = torch.gather(deltas, 1, rows)
            start = anchors[best.indices.reshape(-1)].reshape(chosen.shape)
            decoded = decode_boxes(chosen, start, PROPOSAL_WEIGHTS)
            boxes = clip_boxes(decoded, self.spec.height, self.spec.width)
            levels.append(self._nms(boxes, best.values))
        boxes, scores, valid = (torch.cat(parts, dim=1) for parts in zip(*levels, strict=True))
        lowest = torch.finfo(scores.dtype).min
        ranked = torch.where(valid, scores, torch.full_like(scores, lowest))
        order = torch.topk(ranked, min(count, ranked.shape[1])).indices
        real = torch.gather(valid, 1, order)
        kept = torch.gather(boxes, 1, order[..., None].expand(-1, -1, 4))
        return Proposals(
            torch.where(real[..., None], kept, 0.0),
            torch.where(real, torch.gather(scores, 1, order), 0.0),
            real,
        )

    def _nms(self, boxes: Tensor, scores: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Apply non-maximum suppression to boxes (B, N, 4) and scores (B, N) of one level.

        Returns boxes, scores and (B, N) bool, true for the kept ones.
        """
        valid = ((boxes[..., 2:] - boxes[..., :2]) > 0.0).all(dim=-1)
        iou = self.spec.proposal_nms_iou
        if boxes.device.type != "cpu":
            return boxes, scores, joint_nms_keep_mask(boxes, scores, valid, iou)
        kept = [nms_keep_mask(boxes[i], scores[i], valid[i], iou) for i in range(boxes.shape[0])]
        return boxes, scores, torch.stack(kept)


def _convolution(spec: ModelSpec) -> nn.Module:
    """The convolution that all levels share, dense or separable."""
    width, side = spec.fpn_width, SEPARABLE_SIDE
    if not spec.separable_proposals:
        return nn.Conv2d(width, width, 3, padding=1)
    depthwise = nn.Conv2d(width, width, side, padding=side // 2, groups=width, bias=False)
    return nn.Sequential(depthwise, nn.Conv2d(width, width, 1))
