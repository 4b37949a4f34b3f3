"""Settings of the files that a dataset is made of."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import check_choice

IMAGE_FORMATS = ("jpg", "png")


@dataclass(frozen=True)
class FileSettings:
    """Colour images as JPEG, of the colour sensor's quality, or as PNG without loss."""

    image_format: str = "jpg"

    def __post_init__(self) -> None:
        check_choice("image_format", self.image_format, IMAGE_FORMATS)
