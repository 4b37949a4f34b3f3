"""Fitting an image of any size into a model's input, and points back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import CameraError

Float = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class Letterbox:
    """Resize by one scale, place top-left, pad the rest.

    Sizes in px: ``source`` image, ``resized`` copy of it, and the ``width`` x ``height`` it is
    placed in. Coordinates are corner-based, so that they only scale.
    """

    source_width: int
    source_height: int
    resized_width: int
    resized_height: int
    width: int
    height: int

    @classmethod
    def fit(cls, source_width: int, source_height: int, width: int, height: int) -> Letterbox:
        """The largest copy of the source that fits, its sides rounded to whole pixels."""
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
        """(2,) model px per source px along x and y."""
        return np.array(
            [self.resized_width / self.source_width, self.resized_height / self.source_height]
        )

    def apply(self, image: NDArray[np.uint8], pad_value: int) -> NDArray[np.uint8]:
        """(H, W) or (H, W, C) uint8 source to the same kind of ``height`` x ``width``.

        Area-averaged when shrinking, bilinear when growing. Raises CameraError for an image of
        another size.
        """
        if image.shape[:2] != (self.source_height, self.source_width):
            raise CameraError(
                f"the image is {image.shape[1]}x{image.shape[0]} px: expected"
                f" {self.source_width}x{self.source_height}"
            )
        shrinking = self.resized_width < self.source_width
        resized = cv2.resize(
            image,
            (self.resized_width, self.resized_height),
            interpolation=cv2.INTER_AREA if shrinking else cv2.INTER_LINEAR,
        )
        padded = np.full((self.height, self.width, *image.shape[2:]), pad_value, np.uint8)
        padded[: self.resized_height, : self.resized_width] = resized
        return padded

    def to_model(self, xy_px: ArrayLike) -> Float:
        """(..., 2) source px to model px."""
        return np.asarray(xy_px, np.float64) * self.scale

    def to_source(self, xy_px: ArrayLike) -> Float:
        """(..., 2) model px to source px."""
        return np.asarray(xy_px, np.float64) / self.scale
