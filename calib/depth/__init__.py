"""Depth maps: conversion, encoding, files, noise models and plausibility checks.

In memory a depth map is (H, W) float32, metres along the camera's z axis, with 0 for pixels without
a reading.
"""

from calib.depth.checks import DepthFailure, DepthReport, check_depth, mask_by_confidence
from calib.depth.convention import DepthConvention, DepthKind
from calib.depth.conversion import (
    depth_to_disparity,
    depth_to_range,
    disparity_to_depth,
    range_to_depth,
)
from calib.depth.encoding import DepthEncoding, decode_depth, encode_depth
from calib.depth.files import read_depth, write_depth

__all__ = [
    "DepthConvention",
    "DepthEncoding",
    "DepthFailure",
    "DepthKind",
    "DepthReport",
    "check_depth",
    "decode_depth",
    "depth_to_disparity",
    "depth_to_range",
    "disparity_to_depth",
    "encode_depth",
    "mask_by_confidence",
    "range_to_depth",
    "read_depth",
    "write_depth",
]
