"""Training targets of an image, and the padded true boxes of a batch."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import torch
from torch import Tensor

from perceptree.keypoints import KEYPOINT_NAMES


@dataclasses.dataclass(frozen=True)
class TreeTargets:
    """The labelled trees of one image, in pixels of the network's input.

    Raises:
        ValueError: If shapes do not match, or masks are not bool.
    """

    boxes: Tensor
    """(N, 4) float32, xyxy px."""
    keypoints: Tensor
    """(N, 5, 3) float32: x px, y px, flag (2 visible, 1 hidden, 0 unlabelled)."""
    masks: Tensor | None
    """(N, H, W) bool, the visible pixels; None if the data has no masks."""
    ignored: Tensor = dataclasses.field(default_factory=lambda: torch.zeros(0, 4))
    """(M, 4) float32, xyxy px of regions that are neither trees nor background."""

    def __post_init__(self) -> None:
        count = self.boxes.shape[0]
        expected = {"boxes": (count, 4), "keypoints": (count, len(KEYPOINT_NAMES), 3)}
        for name, shape in expected.items():
            found = tuple(getattr(self, name).shape)
            if found != shape:
                raise ValueError(f"{name} have shape {found}, expected {shape}")
        if self.ignored.ndim != 2 or self.ignored.shape[1] != 4:
            raise ValueError(f"ignored have shape {tuple(self.ignored.shape)}, expected (M, 4)")
        if self.masks is None:
            return
        if self.masks.ndim != 3 or self.masks.shape[0] != count:
            raise ValueError(
                f"masks have shape {tuple(self.masks.shape)}, expected ({count}, H, W)"
            )
        if self.masks.dtype != torch.bool:
            raise ValueError(f"masks are {self.masks.dtype}, expected bool")


@dataclasses.dataclass(frozen=True)
class PaddedBoxes:
    """The true boxes of a batch in one tensor, and its ignored regions in another."""

    boxes: Tensor
    """(B, N, 4) float32 xyxy px, padded with zeros."""
    valid: Tensor
    """(B, N) bool; false for padding."""
    ignored: Tensor | None = None
    """(B, M, 4) float32 xyxy px, padded with zeros; None if no image has ignored regions."""


def pad_boxes(targets: Sequence[TreeTargets], device: torch.device) -> PaddedBoxes:
    """Stack the true boxes and the ignored regions of a batch.

    Args:
        targets: One per image.
        device: Device of the result.

    Returns:
        Boxes padded to the largest number of trees, at least 1, so that reductions over trees are
        defined.
    """
    boxes = _padded([target.boxes for target in targets])
    valid = torch.zeros(boxes.shape[:2], dtype=torch.bool)
    for row, target in enumerate(targets):
        valid[row, : len(target.boxes)] = True
    ignored = None
    if any(len(target.ignored) for target in targets):
        ignored = _padded([target.ignored for target in targets]).to(device)
    return PaddedBoxes(boxes.to(device), valid.to(device), ignored)


def _padded(rows: Sequence[Tensor]) -> Tensor:
    """Stack (N, 4) boxes of each image to (B, most, 4), padded with zeros."""
    padded = torch.zeros(len(rows), max(1, *map(len, rows)), 4)
    for row, boxes in enumerate(rows):
        padded[row, : len(boxes)] = boxes
    return padded
