"""The region proposal network: where trees may be."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from perceptree.models.anchors import level_anchors
from perceptree.models.boxes import clip_boxes, decode_boxes, suppress
from perceptree.models.spec import ModelSpec

PROPOSAL_WEIGHTS = (1.0, 1.0, 1.0, 1.0)


class ProposalMaps(NamedTuple):
    """What the network says of every anchor, level by level."""

    logits: list[Tensor]
    """(B, A_level) float32 each, in the anchors' order."""
    deltas: list[Tensor]
    """(B, A_level, 4) float32 each."""


class Proposals(NamedTuple):
    """Candidate boxes of a batch, a fixed number per image, by falling objectness."""

    boxes: Tensor
    """(B, P, 4) xyxy px, clipped; zero where not valid."""
    valid: Tensor
    """(B, P) bool."""


class ProposalNetwork(nn.Module):
    """One small convolution over all levels, and the choice of proposals."""

    def __init__(self, spec: ModelSpec) -> None:
        super().__init__()
        self.spec = spec
        ratios = len(spec.anchor_ratios)
        self.conv = nn.Conv2d(spec.fpn_width, spec.fpn_width, 3, padding=1)
        self.objectness = nn.Conv2d(spec.fpn_width, ratios, 1)
        self.shift = nn.Conv2d(spec.fpn_width, 4 * ratios, 1)
        nn.init.kaiming_normal_(self.conv.weight, nonlinearity="relu")
        for layer in (self.objectness, self.shift):
            nn.init.normal_(layer.weight, std=0.01)
        for layer in (self.conv, self.objectness, self.shift):
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        for level, size_px in zip(spec.levels, spec.anchor_sizes_px, strict=True):
            stride = 2**level
            cells = spec.height // stride, spec.width // stride
            anchors = level_anchors(*cells, stride, size_px, spec.anchor_ratios)
            self.register_buffer(f"anchors_{level}", anchors, persistent=False)

    def anchors(self) -> list[Tensor]:
        """(A_level, 4) xyxy px of every level."""
        return [self.get_buffer(f"anchors_{level}") for level in self.spec.levels]

    def forward(self, maps: list[Tensor]) -> ProposalMaps:
        """Pyramid maps (B, C, h, w) -> objectness and offsets of every anchor."""
        logits, deltas = [], []
        for x in maps:
            hidden = functional.relu(self.conv(x))
            batch = hidden.shape[0]
            logits.append(self.objectness(hidden).permute(0, 2, 3, 1).reshape(batch, -1).float())
            shift = self.shift(hidden).permute(0, 2, 3, 1)
            deltas.append(shift.reshape(batch, -1, 4).float())
        return ProposalMaps(logits, deltas)

    def propose(self, maps: ProposalMaps, per_level: int, count: int) -> Proposals:
        """The best ``per_level`` anchors of each level, decoded, suppressed to ``count``."""
        boxes, scores = [], []
        for anchors, logits, deltas in zip(self.anchors(), *maps, strict=True):
            best = torch.topk(logits, min(per_level, logits.shape[1]))
            rows = best.indices[..., None].expand(-1, -1, 4)
            chosen = torch.gather(deltas, 1, rows)
            start = anchors[best.indices.reshape(-1)].reshape(chosen.shape)
            decoded = decode_boxes(chosen, start, PROPOSAL_WEIGHTS)
            boxes.append(clip_boxes(decoded, self.spec.height, self.spec.width))
            scores.append(best.values)
        return self._suppress(torch.cat(boxes, 1), torch.cat(scores, 1), count)

    def _suppress(self, boxes: Tensor, scores: Tensor, count: int) -> Proposals:
        valid = ((boxes[..., 2:] - boxes[..., :2]) > 0.0).all(dim=-1)
        count = min(count, boxes.shape[1])
        kept_boxes, kept_valid = [], []
        for i in range(boxes.shape[0]):
            rows, real = suppress(boxes[i], scores[i], valid[i], self.spec.proposal_nms_iou, count)
            kept_boxes.append(torch.where(real[:, None], boxes[i][rows], 0.0))
            kept_valid.append(real)
        return Proposals(torch.stack(kept_boxes), torch.stack(kept_valid))
