"""Resize an image to a model's input size and map points back."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

from basetree.arrays import Float, UInt8
from calib.errors import CameraError
from calib.shrinking import shrink


@dataclass(frozen=True)
class Letterbox:
    """Resize with the aspect ratio kept, place at the top left, pad the rest.

    Coordinates are continuous px, so that mapping them is a scaling alone.

    Attributes:
        source_width: Width of the source image in px.
        source_height: Height of the source image in px.
        resized_width: Width of the resized image in px.
        resized_height: Height of the resized image in px.
        width: Width of the padded image, the model's input, in px.
        height: Height of the padded image in px.

    Examples:
        >>> from calib import Letterbox
        >>> box = Letterbox.fit(1280, 720, 640, 384)  # a frame, and a model's input
        >>> (box.resized_width, box.resized_height)
        (640, 360)
        >>> box.to_source([[320.0, 180.0]])
        array([[640., 360.]])
    """

    source_width: int
    source_height: int
    resized_width: int
    resized_height: int
    width: int
    height: int

    @classmethod
    def fit(cls, source_width: int, source_height: int, width: int, height: int) -> Letterbox:
        """Create the letterbox with the largest scale that fits; sides are rounded to whole px.

        Raises:
            CameraError: If a size is below 1.
        """
        if min(source_width, source_height, width, height) < 1:
            raise CameraError(
                f"cannot fit {source_width}x{source_height} px into {width}x{height}:"
                " expected sizes of at least 1"
            )
        scale = min(width / source_width, height / source_height)
        return cls(
            source_width,
            source_height,
            min(width, max(1, round(source_width * scale))),
            min(height, max(1, round(source_height * scale))),
            width,
            height,
        )

    @property
    def scale(self) -> Float:
        """(2,) model px per source px along x and y; they differ by rounding."""
        return np.array(
            [self.resized_width / self.source_width, self.resized_height / self.source_height]
        )

    def apply(self, image: UInt8, pad_value: int | tuple[int, ...]) -> UInt8:
        """Resize and pad an image.

        Uses area averaging to shrink and bilinear interpolation to enlarge.

        Args:
            image: (source_height, source_width) or (source_height, source_width, C) uint8.
            pad_value: Grey value of the padding, 0 to 255; or one of each channel.

        Returns:
            (height, width) or (height, width, C) uint8.

        Raises:
            CameraError: If the image does not have the source's size.
        """
        if image.shape[:2] != (self.source_height, self.source_width):
            raise CameraError(
                f"the image is {image.shape[1]}x{image.shape[0]} px: expected"
                f" {self.source_width}x{self.source_height}"
            )
        size = (self.resized_width, self.resized_height)
        if self.resized_width < self.source_width:
            resized = shrink(image, *size)
        else:
            resized = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8)
        padded = np.full((self.height, self.width, *image.shape[2:]), pad_value, np.uint8)
        padded[: self.resized_height, : self.resized_width] = resized
        return padded

    def to_model(self, xy_px: ArrayLike) -> Float:
        """Map (..., 2) source px to model px."""
        return np.asarray(xy_px, np.float64) * self.scale

    def to_source(self, xy_px: ArrayLike) -> Float:
        """Map (..., 2) model px to source px."""
        return np.asarray(xy_px, np.float64) / self.scale
