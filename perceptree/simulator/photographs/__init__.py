"""Photographs of bark, ground, stones, leaves and far stands, mixed with procedural textures."""

from perceptree.simulator.photographs.checking import check_photographs
from perceptree.simulator.photographs.folder import (
    PhotoFolder,
    dataset_credits,
    open_photographs,
    with_photographs,
)

__all__ = [
    "PhotoFolder",
    "check_photographs",
    "dataset_credits",
    "open_photographs",
    "with_photographs",
]
