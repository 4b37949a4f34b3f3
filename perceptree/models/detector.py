"""The detector: Mask R-CNN with an optional mask and an optional keypoint branch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor, nn

from perceptree.models import losses
from perceptree.models.backbones import Backbone
from perceptree.models.boxes import clip_boxes, decode_boxes, enlarge_boxes, suppress
from perceptree.models.decode import decode_keypoints, refine_matrix
from perceptree.models.fpn import FeaturePyramid
from perceptree.models.heads import (
    BOX_CELLS,
    BOX_WEIGHTS,
    ROI_CELLS,
    BoxHead,
    KeypointHead,
    MaskHead,
)
from perceptree.models.matching import RegionSample, match_anchors, sample_regions
from perceptree.models.roi_align import pool_regions, pool_regions_by_matrix
from perceptree.models.rpn import ProposalMaps, ProposalNetwork
from perceptree.models.spec import KEYPOINT_NAMES, MASK_CELLS, ModelSpec
from perceptree.models.targets import TreeTargets, pad_boxes

# Training looks at more proposals than deployment, for harder and more varied regions.
TRAINING_PROPOSALS = 2


class Detections(NamedTuple):
    """The trees of a batch, K rows per image by falling score; rows past the count are zero.

    Without its branch, ``keypoints`` or ``masks`` is all zero.
    """

    boxes: Tensor
    """(B, K, 4) float32, xyxy px of the input."""
    scores: Tensor
    """(B, K) float32, 0 to 1."""
    keypoints: Tensor
    """(B, K, 5, 3) float32: x px, y px, softmax peak."""
    masks: Tensor
    """(B, K, 28, 28) float32, probability within the box."""
    num_detections: Tensor
    """(B,) int64."""


class TreeRCNN(nn.Module):
    """A two-stage tree detector after ``spec``, from random weights.

    Images are uint8, (B, H, W, 3) BGR or (B, H, W) encoded depth, of the spec's size.
    """

    matrix: Tensor
    mean: Tensor
    std: Tensor

    def __init__(self, spec: ModelSpec) -> None:
        super().__init__()
        self.spec = spec
        self.backbone = Backbone(spec.backbone, spec.channels, spec.levels)
        self.pyramid = FeaturePyramid(self.backbone.channels, spec.fpn_width)
        self.proposer = ProposalNetwork(spec)
        self.box_head = BoxHead(spec.fpn_width, spec.box_head_width)
        self.mask_head = MaskHead(spec.fpn_width, spec.mask_head_widths) if spec.masks else None
        self.keypoint_head = (
            KeypointHead(spec.fpn_width, spec.keypoint_head_widths) if spec.keypoints else None
        )
        self.register_buffer("mean", torch.tensor(spec.mean)[:, None, None], persistent=False)
        self.register_buffer("std", torch.tensor(spec.std)[:, None, None], persistent=False)
        self.register_buffer("matrix", refine_matrix(), persistent=False)
        # The layout in which CPUs convolve fastest, above all at the finest maps.
        self.to(memory_format=torch.channels_last)

    def normalise(self, images: Tensor) -> Tensor:
        """uint8 images -> (B, C, H, W) float32, mean taken off and divided by std."""
        shape = (self.spec.height, self.spec.width)
        if self.spec.modality == "rgb":
            expected: tuple[int, ...] = (*shape, 3)
        else:
            expected = shape
        if tuple(images.shape[1:]) != expected or images.dtype != torch.uint8:
            raise ValueError(
                f"images are {images.dtype} of shape {tuple(images.shape)}, "
                f"expected torch.uint8 of shape (B, {', '.join(map(str, expected))})"
            )
        x = images.permute(0, 3, 1, 2) if self.spec.modality == "rgb" else images[:, None]
        x = (x.float() - self.mean) / self.std
        return x.contiguous(memory_format=torch.channels_last)

    def features(self, images: Tensor) -> tuple[dict[int, Tensor], ProposalMaps]:
        """uint8 images -> pyramid maps by level, and what the proposal network says."""
        maps = self.pyramid(self.backbone(self.normalise(images)))
        return dict(zip(self.spec.levels, maps, strict=True)), self.proposer(maps)

    def losses(self, images: Tensor, targets: Sequence[TreeTargets]) -> dict[str, Tensor]:
        """The losses of a batch, float32 scalars by name; their sum is to be minimised."""
        maps, proposal_maps = self.features(images)
        with torch.autocast(images.device.type, enabled=False):
            trees = pad_boxes(targets, images.device)
            anchors = torch.cat(self.proposer.anchors())
            with torch.no_grad():
                match = match_anchors(anchors, trees)
                per_level = TRAINING_PROPOSALS * self.spec.proposals_per_level
                count = TRAINING_PROPOSALS * self.spec.proposals
                proposals = self.proposer.propose(proposal_maps, per_level, count)
                sample = sample_regions(proposals.boxes, proposals.valid, trees)
            result = losses.proposal_losses(proposal_maps, anchors, match, trees)
        regions = sample.boxes.flatten(0, 1)
        rows = torch.arange(len(targets), device=images.device)
        owner = rows.repeat_interleave(sample.boxes.shape[1])
        pooled = pool_regions_by_matrix(maps, regions, owner, self.spec.roi_levels, BOX_CELLS)
        logits, shifts = self.box_head(pooled)
        truth = torch.gather(trees.boxes, 1, sample.tree[..., None].expand(-1, -1, 4))
        flags = sample.positive.flatten(), sample.used.flatten()
        result |= losses.box_losses(logits, shifts, regions, truth.flatten(0, 1), *flags)
        return result | self._branch_losses(maps, sample, targets)

    def _branch_losses(
        self, maps: dict[int, Tensor], sample: RegionSample, targets: Sequence[TreeTargets]
    ) -> dict[str, Tensor]:
        image, row = sample.positive.nonzero(as_tuple=True)
        boxes = sample.boxes[image, row]
        if not len(boxes):
            heads = {"mask": self.mask_head, "keypoint": self.keypoint_head}
            return {name: boxes.new_zeros(()) for name, head in heads.items() if head is not None}
        counts = torch.tensor([0] + [len(t.boxes) for t in targets[:-1]], device=boxes.device)
        tree = sample.tree[image, row] + counts.cumsum(0)[image]
        result = {}
        if self.mask_head is not None:
            pooled = pool_regions_by_matrix(maps, boxes, image, self.spec.roi_levels, ROI_CELLS)
            masks = losses.joined(targets, "masks", boxes.device)
            wanted = losses.mask_targets(boxes, masks, tree)
            result["mask"] = losses.mask_loss(self.mask_head(pooled), wanted)
        if self.keypoint_head is not None:
            wide = enlarge_boxes(boxes, self.spec.keypoint_box_scale)
            pooled = pool_regions_by_matrix(maps, wide, image, self.spec.roi_levels, ROI_CELLS)
            keypoints = losses.joined(targets, "keypoints", boxes.device)
            cells, inside = losses.keypoint_targets(wide, keypoints[tree])
            result["keypoint"] = losses.keypoint_loss(self.keypoint_head(pooled), cells, inside)
        return result

    def detect(self, images: Tensor) -> Detections:
        """Find trees; shapes are fixed and no Python branch depends on the pixels."""
        maps, proposal_maps = self.features(images)
        spec = self.spec
        proposals = self.proposer.propose(proposal_maps, spec.proposals_per_level, spec.proposals)
        flat = proposals.boxes.flatten(0, 1)
        logits, shifts = self.box_head(self._pool(maps, flat, proposals.boxes, BOX_CELLS))
        scores = logits.softmax(dim=1)[:, 0].reshape(proposals.valid.shape)
        boxes = clip_boxes(decode_boxes(shifts, flat, BOX_WEIGHTS), spec.height, spec.width)
        boxes, scores, real = self._select(
            boxes.reshape(proposals.boxes.shape), scores, proposals.valid
        )
        keypoints, masks = self._branches(maps, boxes)
        return Detections(
            boxes,
            scores,
            torch.where(real[:, :, None, None], keypoints, 0.0),
            torch.where(real[:, :, None, None], masks, 0.0),
            real.sum(dim=1),
        )

    def _select(
        self, boxes: Tensor, scores: Tensor, valid: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """(B, P, ...) candidates -> the K best boxes, scores and which of them are real."""
        size = boxes[..., 2:] - boxes[..., :2]
        valid = valid & (scores > self.spec.score_threshold) & (size > 0.0).all(dim=-1)
        rows = []
        for i in range(boxes.shape[0]):
            order, real = suppress(
                boxes[i], scores[i], valid[i], self.spec.nms_iou, self.spec.detections
            )
            rows.append(
                (
                    torch.where(real[:, None], boxes[i][order], 0.0),
                    torch.where(real, scores[i][order], 0.0),
                    real,
                )
            )
        kept_boxes, kept_scores, kept = zip(*rows, strict=True)
        return torch.stack(kept_boxes), torch.stack(kept_scores), torch.stack(kept)

    def _branches(self, maps: dict[int, Tensor], boxes: Tensor) -> tuple[Tensor, Tensor]:
        """Keypoints and masks of (B, K, 4) boxes; zeros without the branch."""
        flat = boxes.flatten(0, 1)
        shape = boxes.shape[:2]
        keypoints = flat.new_zeros(*shape, len(KEYPOINT_NAMES), 3)
        masks = flat.new_zeros(*shape, MASK_CELLS, MASK_CELLS)
        if self.keypoint_head is not None:
            wide = enlarge_boxes(flat, self.spec.keypoint_box_scale)
            heat = self.keypoint_head(self._pool(maps, wide, boxes, ROI_CELLS))
            keypoints = decode_keypoints(heat, wide, self.matrix).reshape(keypoints.shape)
        if self.mask_head is not None:
            logits = self.mask_head(self._pool(maps, flat, boxes, ROI_CELLS))
            masks = logits.sigmoid().reshape(masks.shape)
        return keypoints, masks

    def _pool(self, maps: dict[int, Tensor], flat: Tensor, boxes: Tensor, cells: int) -> Tensor:
        """Pool flat (B*R, 4) regions, whose images are those of (B, R, 4) boxes."""
        batch, count = boxes.shape[:2]
        images = torch.arange(batch, device=flat.device).repeat_interleave(count)
        return pool_regions(maps, flat, images, self.spec.roi_levels, cells)
