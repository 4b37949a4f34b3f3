"""Exact depth of simulated frames as model input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from basetree.arrays import Bool, Float32, Int64, UInt8
from basetree.errors import InputFileError
from calib import DepthEncoding, DepthError, Letterbox, encode_depth, read_depth
from perceptree.data.coco import FrameRecord
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec

_ALIKE = 1e-6  # px


def with_exact_depth(frames: Sequence[FrameRecord]) -> list[FrameRecord]:
    """Return the frames with their exact depth in place of the measured one.

    Raises:
        DatasetError: If a frame has none.
    """
    for frame in frames:
        if frame.exact_path is None:
            raise DatasetError(
                f"{frame.image_path}: the dataset has no exact depth for it; expected frames of"
                " perceptree synth, or no --exact-depth"
            )
    return [replace(frame, depth8_path=frame.exact_path) for frame in frames]


def exact_image(frame: FrameRecord, spec: ModelSpec, box: Letterbox, trees: Bool) -> UInt8:
    """Read the exact depth of a frame at the model's size.

    A pixel between samples of the file takes the nearest of them if it belongs to a tree, else the
    farthest, so that edges lie where the labels have them.

    Args:
        frame: A frame of `with_exact_depth`.
        spec: Model whose depth encoding the result has.
        box: How the frame is fitted into the model's input.
        trees: (H, W) pixels of trees, in model px.

    Returns:
        (H, W) uint8 depth image.

    Raises:
        DatasetError: If the file is missing, broken or of another size.
    """
    path = frame.exact_path
    assert path is not None
    assert spec.depth_encoding is not None
    try:
        metres = read_depth(path)
    except (InputFileError, DepthError) as error:
        raise DatasetError(str(error)) from error
    stride = frame.exact_stride_px
    expected = (-(-frame.height // stride), -(-frame.width // stride))
    if metres.shape != expected:
        raise DatasetError(
            f"{path}: is {metres.shape[1]}x{metres.shape[0]} px, expected"
            f" {expected[1]}x{expected[0]}: one in {stride} pixels of the frame each way"
        )
    metres = np.where(metres > 0, metres, np.float32(np.inf))
    rows = _samples(box.resized_height, float(box.scale[1]), stride, len(metres))
    columns = _samples(box.resized_width, float(box.scale[0]), stride, metres.shape[1])
    around = [metres[np.ix_(y, x)] for y in rows for x in columns]
    part = (slice(box.resized_height), slice(box.resized_width))
    found = np.where(trees[part], _reduced(np.minimum, around), _reduced(np.maximum, around))
    image = np.full((box.height, box.width), spec.pad_value, np.uint8)
    encoding = DepthEncoding.from_dict(spec.depth_encoding)
    image[part] = encode_depth(np.where(np.isfinite(found), found, 0), encoding)
    return image


def _samples(count: int, scale: float, stride: int, size: int) -> tuple[Int64, Int64]:
    """Indices of the samples before and after the centres of `count` model pixels."""
    places = ((np.arange(count) + 0.5) / scale - 0.5) / stride
    before, after = np.floor(places + _ALIKE), np.ceil(places - _ALIKE)
    first, second = (np.clip(each, 0, size - 1).astype(np.int64) for each in (before, after))
    return first, second


def _reduced(least_or_most: np.ufunc, around: list[Float32]) -> Float32:
    return np.asarray(least_or_most.reduce(around), np.float32)
