"""The region proposal network: where trees may be."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from perceptree.models.anchors import level_anchors
from perceptree.models.boxes import clip_boxes, decode_boxes, survivors
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
    scores: Tensor
    """(B, P) objectness logits; zero where not valid."""
    valid: Tensor
    """(B, P) bool."""


class ProposalNetwork(nn.Module):
    """One small convolution over all levels, and the choice of proposals."""

    def __init__(self, spec: ModelSpec) -> None:
        super().__init__()
        self.spec = spec
        anchors = spec.anchors_per_cell
        self.conv = nn.Conv2d(spec.fpn_width, spec.fpn_width, 3, padding=1)
        self.objectness = nn.Conv2d(spec.fpn_width, anchors, 1)
        self.shift = nn.Conv2d(spec.fpn_width, 4 * anchors, 1)
        nn.init.kaiming_normal_(self.conv.weight, nonlinearity="relu")
        for layer in (self.objectness, self.shift):
            nn.init.normal_(layer.weight, std=0.01)
        for layer in (self.conv, self.objectness, self.shift):
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
        for level, sizes_px in zip(spec.levels, spec.anchor_sizes_px, strict=True):
            boxes = level_anchors(
                *spec.map_size(level), 2**level, sizes_px, spec.anchor_ratios, spec.anchor_offset
            )
            self.register_buffer(f"anchors_{level}", boxes, persistent=False)

    def anchors(self) -> list[Tensor]:
        """(A_level, 4) xyxy px of every level."""
        return [self.get_buffer(f"anchors_{level}") for level in self.spec.levels]

    def forward(self, maps: list[Tensor]) -> ProposalMaps:
        """Pyramid maps (B, C, h, w) -> objectness and offsets of every anchor."""
        logits, deltas = [], []
        for x in maps:
            hidden = functional.relu(self.conv(x), inplace=True)
            batch = hidden.shape[0]
            logits.append(self.objectness(hidden).permute(0, 2, 3, 1).reshape(batch, -1).float())
            shift = self.shift(hidden).permute(0, 2, 3, 1)
            deltas.append(shift.reshape(batch, -1, 4).float())
        return ProposalMaps(logits, deltas)

    def propose(self, maps: ProposalMaps, per_level: int, count: int) -> Proposals:
        """The best ``per_level`` anchors of each level, decoded, suppressed within their level.

        Of what is left the best ``count`` of all levels.
        """
        levels = []
        for anchors, logits, deltas in zip(self.anchors(), *maps, strict=True):
            best = torch.topk(logits, min(per_level, logits.shape[1]))
            rows = best.indices[..., None].expand(-1, -1, 4)
            chosen = torch.gather(deltas, 1, rows)
            start = anchors[best.indices.reshape(-1)].reshape(chosen.shape)
            decoded = decode_boxes(chosen, start, PROPOSAL_WEIGHTS)
            boxes = clip_boxes(decoded, self.spec.height, self.spec.width)
            levels.append(self._suppress(boxes, best.values))
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

    def _suppress(self, boxes: Tensor, scores: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """(B, N, 4) and (B, N) of one level -> boxes, scores and which are kept."""
        valid = ((boxes[..., 2:] - boxes[..., :2]) > 0.0).all(dim=-1)
        alive = [
            survivors(boxes[i], scores[i], valid[i], self.spec.proposal_nms_iou)
            for i in range(boxes.shape[0])
        ]
        return boxes, scores, torch.stack(alive)
