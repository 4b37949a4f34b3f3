"""Settings of a dataset's files."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import check_choice

IMAGE_FORMATS = ("jpg", "png")


@dataclass(frozen=True)
class FileSettings:
    """File formats of a dataset.

    Attributes:
        image_format: Format of colour images: ``jpg``, with the quality in RgbSettings, or ``png``.

    Raises:
        SettingsError: If the format is unknown.
    """

    image_format: str = "jpg"

    def __post_init__(self) -> None:
        check_choice("image_format", self.image_format, IMAGE_FORMATS)
