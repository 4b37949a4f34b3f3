"""Settings of a dataset's files."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings, names

IMAGE_FORMATS = ("jpg", "png")


@dataclass(frozen=True)
class FileSettings(Settings):
    """File formats of a dataset."""

    image_format: str = field(default="jpg", metadata=names(IMAGE_FORMATS))
    """Format of colour images: `jpg`, with the quality in RgbSettings, or `png`."""
