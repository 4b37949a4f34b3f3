"""How a training step samples anchors and regions."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings, limits

_COUNT = limits(1)
_SHARE = limits(over=0, most=1)


@dataclass(frozen=True)
class SampleSettings(Settings):
    """How a training step samples anchors and regions in each image.

    Training uses more proposals than deployment, because that gives harder and more varied
    regions.
    """

    proposals_per_level: int = field(default=200, metadata=_COUNT)
    """Proposals kept per pyramid level before non-maximum suppression."""
    proposals: int = field(default=200, metadata=_COUNT)
    """Proposals kept per image after it."""
    anchors: int = field(default=128, metadata=_COUNT)
    """Anchors sampled per image."""
    anchor_positive_share: float = field(default=0.5, metadata=_SHARE)
    """Maximum fraction of positive anchors among them."""
    anchor_positive_iou: float = field(default=0.5, metadata=_SHARE)
    """Minimum overlap of a positive anchor with a tree."""
    anchor_negative_iou: float = 0.3
    """Overlap below which an anchor is negative."""
    regions: int = field(default=64, metadata=_COUNT)
    """Regions sampled per image for the heads."""
    region_positive_share: float = field(default=0.375, metadata=_SHARE)
    """Maximum fraction of positive regions among them."""
    region_positive_iou: float = field(default=0.5, metadata=_SHARE)
    """Minimum overlap of a positive region with a tree."""
    box_beta: float = field(default=0.0, metadata=limits(0))
    """Parameter of the smooth L1 loss of the box offsets (Girshick 2015), the value where it
    changes from quadratic to linear; 0 is plain L1."""

    def _check_together(self) -> None:
        if not 0.0 <= self.anchor_negative_iou <= self.anchor_positive_iou:
            self._refuse(
                f"anchor_negative_iou is {self.anchor_negative_iou}",
                f"0 to anchor_positive_iou ({self.anchor_positive_iou})",
            )


PAPER_SAMPLING = SampleSettings(
    proposals_per_level=2000,
    proposals=1500,
    anchors=256,
    anchor_positive_iou=0.7,
    regions=256,
    region_positive_share=0.25,
    box_beta=0.5,
)
"""Sampling of Grondin et al. (2022): Detectron2's keypoint configuration with 256 regions."""
