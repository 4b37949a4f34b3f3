"""The detector: Mask R-CNN (He et al. 2017) with optional mask and keypoint heads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from perceptree.keypoints import KEYPOINT_NAMES
from perceptree.models import losses
from perceptree.models.boxes import (
    clip_boxes,
    decode_boxes,
    enlarge_boxes,
    nms_top_k,
    vote_boxes,
)
from perceptree.models.decode import decode_keypoints, keypoint_stds
from perceptree.models.heads import (
    BOX_CELLS,
    BOX_WEIGHTS,
    ROI_CELLS,
    BoxHead,
    KeypointHead,
    MaskHead,
)
from perceptree.models.inputs import Images
from perceptree.models.losses import CountReducer, local_count
from perceptree.models.matching import (
    RandomDraw,
    RegionSample,
    match_anchors,
    sample_regions,
    uniform_draw,
)
from perceptree.models.roi_align import RegionPooler
from perceptree.models.rpn import ProposalMaps, ProposalNetwork
from perceptree.models.scores import highest_scores, joint_scores, mask_certainty
from perceptree.models.spec import MASK_CELLS, ModelSpec
from perceptree.models.targets import TreeTargets, pad_boxes
from perceptree.models.trunk import Trunk
from perceptree.settings.sampling import SampleSettings


class Detections(NamedTuple):
    """The detected trees of a batch: K rows per image by descending score, padded with zeros.

    `keypoints`, `keypoint_stds` and `masks` are all zero if the model has no such head.
    """

    boxes: Tensor
    """(B, K, 4) float32, xyxy px of the input."""
    scores: Tensor
    """(B, K) float32, 0 to 1."""
    keypoints: Tensor
    """(B, K, 5, 3) float32: x px, y px, score 0 to 1 (the softmax at the peak)."""
    keypoint_stds: Tensor
    """(B, K, 5, 2) float32, standard deviations of the keypoints' heat maps across and down the
    image, px."""
    masks: Tensor
    """(B, K, 28, 28) float32, probability of each cell of the box to be stem."""
    num_detections: Tensor
    """(B,) int64, number of detections in each image."""


class TreeRCNN(Trunk):
    """A two-stage tree detector with random weights.

    Its methods take images as `Trunk` does.

    Args:
        spec: Architecture and input of the network.

    Raises:
        SpecError: If the spec's backbone cannot be built.
    """

    def __init__(self, spec: ModelSpec) -> None:
        super().__init__(spec)
        self.proposer = ProposalNetwork(spec)
        self.box_head = BoxHead(spec.fpn_width, spec.box_head_width)
        self.mask_head = MaskHead(spec.fpn_width, spec.mask_head_widths) if spec.masks else None
        self.keypoint_head = (
            KeypointHead(spec.fpn_width, spec.keypoint_head_widths) if spec.keypoints else None
        )
        # Convolutions on CPUs are fastest in this memory layout.
        self.to(memory_format=torch.channels_last)

    def features(self, images: Images) -> tuple[dict[int, Tensor], ProposalMaps]:
        """Compute the pyramid maps of uint8 images by level, and the proposal network's output."""
        maps = self.maps(images)
        return maps, self.proposer(list(maps.values()))

    def losses(
        self,
        images: Images,
        targets: Sequence[TreeTargets],
        sampling: SampleSettings | None = None,
        draw: RandomDraw = uniform_draw,
        mean_count: CountReducer = local_count,
    ) -> dict[str, Tensor]:
        """Compute the training losses of a batch. Their sum is to be minimised.

        Args:
            images: The images, as the class takes them.
            targets: One per image, with masks if the model has a mask head.
            sampling: How anchors and regions are sampled.
            draw: Source of the random numbers for the sampling.
            mean_count: Mean of a count over the training processes.

        Returns:
            float32 scalars: `objectness`, `proposal_shift`, `score`, `box_shift` and, if
            the model has these heads, `mask` and `keypoint`.

        Raises:
            ValueError: If the images are not the spec's, or masks are missing.
        """
        sampling = sampling or SampleSettings()
        maps, proposal_maps = self.features(images)
        device = self.mean.device
        with torch.autocast(device.type, enabled=False):
            trees = pad_boxes(targets, device)
            anchors = torch.cat(self.proposer.anchors())
            with torch.no_grad():
                match = match_anchors(anchors, trees, sampling, draw)
                proposals = self.proposer.propose(
                    proposal_maps, sampling.proposals_per_level, sampling.proposals
                )
                sample = sample_regions(proposals.boxes, proposals.valid, trees, sampling, draw)
            result = losses.proposal_losses(proposal_maps, anchors, match, trees, mean_count)
        regions = sample.boxes.flatten(0, 1)
        rows = torch.arange(len(targets), device=device)
        owner = rows.repeat_interleave(sample.boxes.shape[1])
        pooler = RegionPooler(maps, self.spec.roi_levels, self.spec.roi_samples)
        logits, shifts = self.box_head(pooler(regions, owner, BOX_CELLS))
        truth = torch.gather(trees.boxes, 1, sample.tree[..., None].expand(-1, -1, 4))
        flags = sample.positive.flatten(), sample.used.flatten()
        result |= losses.box_losses(
            logits, shifts, regions, truth.flatten(0, 1), *flags, sampling.box_beta, mean_count
        )
        return result | self._branch_losses(pooler, sample, targets, mean_count)

    def _branch_losses(
        self,
        pooler: RegionPooler,
        sample: RegionSample,
        targets: Sequence[TreeTargets],
        mean_count: CountReducer,
    ) -> dict[str, Tensor]:
        image, row = sample.positive.nonzero(as_tuple=True)
        boxes = sample.boxes[image, row]
        counts = torch.tensor([0] + [len(t.boxes) for t in targets[:-1]], device=boxes.device)
        tree = sample.tree[image, row] + counts.cumsum(0)[image]
        result = {}
        if self.mask_head is not None:
            pooled = pooler(boxes, image, ROI_CELLS)
            masks = losses.concatenate_on_device([_masks(t) for t in targets], boxes.device)
            wanted = losses.mask_targets(boxes, masks, tree)
            result["mask"] = losses.mask_loss(self.mask_head(pooled), wanted, mean_count)
        if self.keypoint_head is not None:
            wide = self._enlarged(boxes)
            pooled = pooler(wide, image, ROI_CELLS)
            keypoints = losses.concatenate_on_device([t.keypoints for t in targets], boxes.device)
            cells, inside = losses.keypoint_targets(wide, keypoints[tree])
            heat = self.keypoint_head(pooled)
            result["keypoint"] = losses.keypoint_loss(heat, cells, inside, mean_count)
        return result

    def detect(
        self, images: Images, every_row: bool = False, lowest_score: Tensor | None = None
    ) -> Detections:
        """Detect trees.

        The outputs' shapes are fixed and no Python branch depends on pixel values, so the method
        can be traced.

        Args:
            images: The images, as the class takes them.
            every_row: Whether the mask and keypoint heads run on all K rows, not only on those
                with a box. That is slower, but no shape within depends on the images.
            lowest_score: (1,) float32, takes the place of the spec's `score_threshold`.

        Raises:
            ValueError: If the images are not of the spec's kinds, dtype or shape.
        """
        maps, proposal_maps = self.features(images)
        spec = self.spec
        proposals = self.proposer.propose(proposal_maps, spec.proposals_per_level, spec.proposals)
        pooler = RegionPooler(maps, spec.roi_levels, spec.roi_samples)
        flat, images_of = _flattened(proposals.boxes)
        logits, shifts = self.box_head(pooler(flat, images_of, BOX_CELLS))
        scores = logits.softmax(dim=1)[:, 0].reshape(proposals.valid.shape)
        boxes = clip_boxes(decode_boxes(shifts, flat, BOX_WEIGHTS), spec.height, spec.width)
        lowest = spec.score_threshold if lowest_score is None else lowest_score
        weight = spec.mask_score_weight
        # A box whose score a mask could raise above the threshold is kept until then.
        high = (highest_scores(scores, weight) if weight else scores) >= lowest
        boxes, scores, real = self._select(
            boxes.reshape(proposals.boxes.shape), scores, proposals.valid, high
        )
        branches = self._branches(pooler, boxes, real, every_row)
        found = Detections(boxes, scores, *branches, real.sum(dim=1))
        return self._scored_with_masks(found, real, lowest) if weight else found

    def _select(
        self, boxes: Tensor, scores: Tensor, valid: Tensor, high: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Keep the K best of (B, P, ...) candidates: boxes, scores and a validity mask.

        Those that are not `high` enough are not kept, but they have their vote.
        """
        size = boxes[..., 2:] - boxes[..., :2]
        valid = valid & (size > 0.0).all(dim=-1)
        rows = []
        for i in range(boxes.shape[0]):
            order, real = nms_top_k(
                boxes[i], scores[i], valid[i] & high[i], self.spec.nms_iou, self.spec.detections
            )
            kept = boxes[i][order]
            if self.spec.box_voting:
                votes = torch.where(valid[i], scores[i], 0.0)
                kept = vote_boxes(kept, boxes[i], votes, self.spec.nms_iou)
            rows.append(
                (
                    torch.where(real[:, None], kept, 0.0),
                    torch.where(real, scores[i][order], 0.0),
                    real,
                )
            )
        kept_boxes, kept_scores, kept_rows = zip(*rows, strict=True)
        return torch.stack(kept_boxes), torch.stack(kept_scores), torch.stack(kept_rows)

    def _scored_with_masks(
        self, found: Detections, real: Tensor, lowest: Tensor | float
    ) -> Detections:
        """Join the scores of detections with those of their masks, and sort them anew.

        Args:
            found: The detections.
            real: (B, K), whether a row holds one.
            lowest: Those with a lower score are left out.
        """
        certainty = mask_certainty(found.masks)
        scores = joint_scores(found.scores, certainty, self.spec.mask_score_weight)
        real = real & (scores >= lowest)
        ranked, order = torch.where(real, scores, -1.0).topk(scores.shape[1], dim=1)
        kept = ranked >= 0.0
        rows = torch.arange(len(scores), device=scores.device)[:, None]
        boxes, keypoints, stds, masks = (
            values[rows, order].masked_fill(~_spread(kept, values), 0.0)
            for values in (found.boxes, found.keypoints, found.keypoint_stds, found.masks)
        )
        scores = ranked.clamp(min=0.0)
        return Detections(boxes, scores, keypoints, stds, masks, kept.sum(dim=1))

    def _branches(
        self, pooler: RegionPooler, boxes: Tensor, real: Tensor, every_row: bool
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Keypoints, their deviations, and masks of (B, K, 4) boxes.

        They are zero for boxes that are not real (B, K), and where the model has no such head.
        """
        spec = self.spec
        shape = boxes.shape[:2]
        keypoints = boxes.new_zeros(*shape, len(KEYPOINT_NAMES), 3)
        stds = boxes.new_zeros(*shape, len(KEYPOINT_NAMES), 2)
        masks = boxes.new_zeros(*shape, MASK_CELLS, MASK_CELLS)
        rows, order = _rows_of(real, every_row)
        flat, images = (values[rows] for values in _flattened(boxes))
        shared = spec.keypoint_box_scale == 1.0 or self.keypoint_head is None
        pooled = pooler(flat, images, ROI_CELLS) if shared or spec.masks else None
        if self.keypoint_head is not None:
            wide = flat if shared else self._enlarged(flat)
            heat = self.keypoint_head(pooled if shared else pooler(wide, images, ROI_CELLS))
            longest_px = max(spec.height, spec.width)
            points = decode_keypoints(heat, wide, spec.keypoint_grid, longest_px)
            keypoints = points[order].reshape(keypoints.shape)
            stds = keypoint_stds(heat, points, wide)[order].reshape(stds.shape)
        if self.mask_head is not None:
            masks = self.mask_head(pooled).sigmoid()[order].reshape(masks.shape)
        missing = ~real[:, :, None, None]
        keypoints, stds, masks = (x.masked_fill(missing, 0.0) for x in (keypoints, stds, masks))
        return keypoints, stds, masks

    def _enlarged(self, boxes: Tensor) -> Tensor:
        """The area that the keypoint head uses for (R, 4) boxes, clipped to the image."""
        wide = enlarge_boxes(boxes, self.spec.keypoint_box_scale)
        return clip_boxes(wide, self.spec.height, self.spec.width)


def _spread(flags: Tensor, values: Tensor) -> Tensor:
    """Flags (B, K) of the rows of values (B, K, ...), with as many axes."""
    return flags.reshape(*flags.shape, *(1,) * (values.ndim - flags.ndim))


def _masks(target: TreeTargets) -> Tensor:
    if target.masks is None:
        raise ValueError("targets have no masks: expected masks, or a model without a mask head")
    return target.masks


def _flattened(boxes: Tensor) -> tuple[Tensor, Tensor]:
    """Flatten (B, R, 4) boxes to (B * R, 4), and return the image index (B * R,) of each."""
    batch, count = boxes.shape[:2]
    images = torch.arange(batch, device=boxes.device).repeat_interleave(count)
    return boxes.flatten(0, 1), images


def _rows_of(real: Tensor, every_row: bool) -> tuple[Tensor, Tensor]:
    """Choose the boxes that the mask and keypoint heads run on.

    The first box is always among them, as not all runtimes can run a head on no box.

    Args:
        real: (B, K), whether a row holds a box.
        every_row: Whether to choose all rows.

    Returns:
        (N,) int64, the numbers of the chosen rows among all B * K; and (B * K,) int64, for each row
        its place among the chosen ones. A row that is not chosen has the place of one before it.
    """
    numbers = torch.arange(real.numel(), device=real.device)
    if every_row:
        return numbers, numbers
    kept = real.flatten() | (numbers == 0)
    return kept.nonzero()[:, 0], kept.cumsum(0) - 1
