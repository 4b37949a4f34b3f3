"""What is known of a picture before it is decoded."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple


class NotOffered(ValueError):
    """A picture of a kind that is not read; the message names the kind and what to do."""


class DepthNote(NamedTuple):
    """What a depth image in a picture's file is.

    Attributes:
        words: To follow "a depth image".
        is_metric: Whether its values are metres, so that it can be read.
    """

    words: str
    is_metric: bool


@dataclass(frozen=True)
class PictureHeader:
    """What a picture file states.

    Attributes:
        format_name: Such as "JPEG".
        width: Width in px, as stored.
        height: Height in px, as stored.
        channels: Values of a pixel, as stored.
        sample_bytes: Bytes of a value: 1, 2, 4 or 8.
        decoder_bytes: Memory that a decoder takes beside the decoded pixels.
        orientation: EXIF orientation, 1 to 8: how the stored pixels are to be turned; 1 if the
            file states none.
        focal_px: Focal length in px that EXIF metadata state; None if they state none.
        depth: What the depth image in the file is; None if there is none.
        is_whole: Whether the file holds the bytes that it states, as far as that is told.
    """

    format_name: str
    width: int
    height: int
    channels: int
    sample_bytes: int = 1
    decoder_bytes: int = 0
    orientation: int = 1
    is_whole: bool = True
    focal_px: float | None = None
    depth: DepthNote | None = None

    def reading_bytes(self, channels: int, sample_bytes: int) -> int:
        """Memory that reading takes at its peak, for decoded pixels of so many bytes.

        OpenCV holds the decoded pixels twice, the second time when its decoder is done.
        """
        decoded = self.width * self.height * channels * sample_bytes
        return decoded + max(decoded, self.decoder_bytes)
