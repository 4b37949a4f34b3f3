"""Frames of a camera or a recording, and the protocol of their sources."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform

__all__ = ["REMARKS", "LiveFrame", "LiveSource", "SourceLost"]

REMARKS: Final = frozenset(
    {
        "without pose",
        "without gravity",
        "depth not aligned",
        "transforms that are no rotation",
        "end missing",
        "ended early",
    }
)
"""Names in `LiveSource.counts` that are remarks, on frames that were used or on the source."""


@dataclass(frozen=True, eq=False)
class LiveFrame:
    """One frame with all that its source knows about it.

    Attributes:
        number: number of the frame in its source, from 0 on. Numbers of left-out frames are
            missing.
        time_s: time stamp of the picture, s, in the clock of the source.
        image: (H, W, 3) uint8 BGR; None if there is only depth.
        depth_m: (H, W) float32 metres along the optical axis, 0.0 = no reading, aligned with the
            image; None if there is only colour.
        camera: intrinsics of the image; None if the source does not know them.
        up_camera: (3,) unit vector away from gravity in the camera's frame; None if unknown.
        pose: transform from the camera's frame to a fixed frame (x and y level, z up), as from the
            machine's odometry; None if unknown.
        depth_fault: why the depth is unusable; None if it is usable.
    """

    number: int
    time_s: float
    image: NDArray[np.uint8] | None
    depth_m: NDArray[np.float32] | None = None
    camera: PinholeCamera | None = None
    up_camera: NDArray[np.float64] | None = None
    pose: RigidTransform | None = None
    depth_fault: str | None = None


class LiveSource(Protocol):
    """A camera or a recording. Iterate over it once; `close` may be called at any time."""

    @property
    def name(self) -> str:
        """What messages call it, such as the path or the address."""

    @property
    def is_live(self) -> bool:
        """Whether frames that are not taken in time are lost, as of a camera."""

    @property
    def counts(self) -> dict[str, int]:
        """What was left out so far, such as {"colour without depth": 3}, and `REMARKS`."""

    def __iter__(self) -> Iterator[LiveFrame]:
        """Yield the frames.

        Raises:
            SourceLost: the camera does not answer any more. It may be opened again.
            InputError: the source cannot be read.
        """

    def close(self) -> None:
        """Release the camera or the file; an iteration in progress ends."""


class SourceLost(InputError):
    """A camera does not answer any more."""
