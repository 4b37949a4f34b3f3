"""The labels of a batch in few tensors, which travel fast between processes and to a GPU."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from perceptree.data import Sample
from perceptree.models import TreeTargets

_BITS_OF_A_BYTE = (128, 64, 32, 16, 8, 4, 2, 1)


@dataclass(frozen=True)
class PackedTargets:
    """The labelled trees and ignored regions of all images of a batch, one after the other.

    Attributes:
        trees: Number of trees of each image.
        regions: Number of ignored regions of each image.
        boxes: (N, 4) float32.
        keypoints: (N, 5, 3) float32.
        ignored: (M, 4) float32.
        masks: (N, H, ceil(W / 8)) uint8, eight pixels in a byte; None without masks.
        width: W in px.
    """

    trees: list[int]
    regions: list[int]
    boxes: Tensor
    keypoints: Tensor
    ignored: Tensor
    masks: Tensor | None
    width: int

    def pin_memory(self) -> PackedTargets:
        """The same in page-locked memory, which DataLoader asks for."""
        masks = None if self.masks is None else self.masks.pin_memory()
        return PackedTargets(
            self.trees, self.regions, self.boxes, self.keypoints, self.ignored, masks, self.width
        )

    def unpack(self, device: torch.device) -> list[TreeTargets]:
        """The labels of each image, with masks on a device."""
        masks: Sequence[Tensor | None] = [None] * len(self.trees)
        if self.masks is not None:
            masks = torch.split(self._masks_on(device), self.trees)
        return [
            TreeTargets(boxes, keypoints, mask, ignored)
            for boxes, keypoints, mask, ignored in zip(
                torch.split(self.boxes, self.trees),
                torch.split(self.keypoints, self.trees),
                masks,
                torch.split(self.ignored, self.regions),
                strict=True,
            )
        ]

    def _masks_on(self, device: torch.device) -> Tensor:
        assert self.masks is not None
        packed = self.masks.to(device, non_blocking=True)
        bits = torch.tensor(_BITS_OF_A_BYTE, dtype=torch.uint8, device=device)
        return (packed[..., None] & bits).ne(0).flatten(-2)[..., : self.width]


def pack_targets(samples: Sequence[Sample]) -> PackedTargets:
    """Pack the labels of a batch.

    Args:
        samples: Its frames, all with masks or all without.
    """
    targets = [sample.targets() for sample in samples]
    masks = None
    if targets and all(target.masks is not None for target in targets):
        parts = [np.packbits(np.asarray(target.masks), axis=-1) for target in targets]
        masks = torch.from_numpy(np.concatenate(parts))
    return PackedTargets(
        [len(target.boxes) for target in targets],
        [len(target.ignored) for target in targets],
        torch.cat([target.boxes for target in targets]),
        torch.cat([target.keypoints for target in targets]),
        torch.cat([target.ignored for target in targets]),
        masks,
        samples[0].image.shape[1],
    )
