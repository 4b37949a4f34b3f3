"""Augmentation that a test turns on by parts."""

from perceptree.data import AugmentSettings

STILL = AugmentSettings(
    flip_share=0,
    scale=(1, 1),
    saturation=0,
    brightness=0,
    contrast=0,
    gamma=0,
    tint=0,
    noise=0,
    depth_gain=0,
    depth_noise=0,
    holes=0,
    misaligned_share=0,
    without_colour_share=0,
    without_depth_share=0,
)
"""Changes nothing."""
