"""Whether stems are followed through the frames of a source well enough to count them."""

from __future__ import annotations

from typing import Final

# Where fewer of the detections than this share are of a followed stem, nothing was counted.
_LEAST_FOLLOWED: Final = 0.5


def are_followed(followed: int, detections: int) -> bool:
    """Whether enough of the trees have the number of a stem.

    Args:
        followed: Trees with a number, in all frames.
        detections: All trees in all frames.
    """
    return followed >= _LEAST_FOLLOWED * detections
