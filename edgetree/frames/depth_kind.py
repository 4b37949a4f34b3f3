"""Tell over the frames of a stream whether its depth is of the kind that the rig says."""

from __future__ import annotations

from typing import Final

from calib import PinholeCamera
from calib.depth.range_check import RangeExponent, kind_words, range_exponent
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig

_FRAMES: Final = 20
_EVERY: Final = 5  # neighbouring frames of a stream show the same ground


def ground_exponents(frame: Frame, camera: PinholeCamera | None, rig: Rig) -> list[RangeExponent]:
    """What the ground of a frame tells of the kind of its depth; empty if it tells nothing."""
    if frame.depth_m is None or camera is None or frame.depth_fault is not None:
        return []
    if frame.filled_depth_m is not None:  # beams of a scanner are projected
        return []
    up_camera = rig.up_camera if frame.up_camera is None else frame.up_camera
    found = range_exponent(frame.depth_m, camera, up_camera, rig.depth_kind)
    return [found] if isinstance(found, RangeExponent) else []


class StreamDepthKind:
    """The kind of the depth of a stream, by the ground in some of its first frames.

    Args:
        rig: What the frames are taken for.
    """

    def __init__(self, rig: Rig) -> None:
        self._rig = rig
        self._seen = 0
        self._exponents: list[RangeExponent] = []

    def words(self, frame: Frame) -> str | None:
        """That the depth looks like the other kind, once, when it can be told; else None.

        Args:
            frame: The next frame, with its camera.
        """
        number, self._seen = self._seen, self._seen + 1
        if number % _EVERY or number >= _FRAMES * _EVERY:
            return None
        self._exponents += ground_exponents(frame, frame.camera, self._rig)
        if number < (_FRAMES - 1) * _EVERY:
            return None
        return kind_words(self._exponents, self._rig.depth_kind)
