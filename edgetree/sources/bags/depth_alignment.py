"""Bring depth into the pixels of the colour."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

import calib
from edgetree.frames.rig import DepthReading
from edgetree.sources.bags.topic_words import is_aligned
from edgetree.sources.bags.transforms import TransformTree
from edgetree.sources.source import DEPTH_PLACED_BY_GUESS

_NOT_ALIGNED: Final = "depth not aligned"
# Half a pixel: a reading stays at its pixel.
_SAME_LENS_PX: Final = 0.5
_GRID: Final = 9


@dataclass(frozen=True)
class View:
    """A picture's place: whose frame it is in, its size and its camera.

    Attributes:
        frame: Name of its frame; empty if its driver does not set it.
        size_px: Width and height.
        camera: Its camera as the recording states it; None if it is not known.
    """

    frame: str
    size_px: tuple[int, int]
    camera: calib.PinholeCamera | None

    def __str__(self) -> str:
        focal = "" if self.camera is None else f", focal length {self.camera.fx:.1f} px,"
        return f"{self.size_px[0]}x{self.size_px[1]} px{focal} in frame {self.frame!r}"


class DepthAlignment:
    """Brings the depth of a recording into the pixels of its colour.

    Depth is aligned if a frame or a name says so and the cameras do not say otherwise. All other
    depth is registered.

    Args:
        topic: The depth's topic.
        tree: The transforms.
        counts: Where frames whose depth is not aligned are counted.
        say: Called with lines about what is wrong or was assumed.
    """

    def __init__(
        self, topic: str, tree: TransformTree, counts: Counter[str], say: Callable[[str], None]
    ) -> None:
        self._topic, self._tree, self._counts, self._say = topic, tree, counts, say
        self._is_named_so = is_aligned(topic)

    def is_aligned(self, depth: View, colour: View) -> bool:
        """Whether depth is in the pixels of the colour already, as the recording says."""
        is_claimed = depth.frame == colour.frame or self._is_named_so
        differ = _differ(depth.camera, colour.camera)
        return is_claimed and not differ and depth.size_px == colour.size_px

    def aligned(
        self,
        reading: DepthReading,
        depth: View,
        colour: View,
        stamp_ns: int,
        given: calib.PinholeCamera | None = None,
    ) -> DepthReading:
        """The depth in the pixels of the colour image.

        Args:
            reading: The depth in its own pixels.
            depth: The view of the depth.
            colour: The view of the colour.
            stamp_ns: Time of the depth, ns.
            given: The camera of the colour, if it is given; depth is moved into its pixels. Whether
                depth is aligned is told by the recorded cameras alone.
        """
        if self.is_aligned(depth, colour):
            if not depth.frame and not self._is_named_so and depth.camera is None:
                self._say(
                    f"neither a frame nor a CameraInfo says where depth of {self._topic} was taken:"
                    " it counts as aligned with the colour"
                )
            return reading
        is_claimed = depth.frame == colour.frame or self._is_named_so
        differ = _differ(depth.camera, colour.camera)
        camera = given or colour.camera
        is_elsewhere = depth.frame != colour.frame
        transform = self._tree.lookup(depth.frame, colour.frame, stamp_ns) if is_elsewhere else None
        is_guess = transform is None and is_claimed
        if is_guess:
            transform = calib.RigidTransform.identity()
        if transform is None or depth.camera is None or camera is None:
            return self._fault(depth, colour, has_transform=transform is not None)
        if is_guess and differ:
            self._counts[DEPTH_PLACED_BY_GUESS] += 1
            self._say(
                f"depth of {self._topic} is {depth} and colour {colour}: it is not aligned, and no"
                " transform says where the two cameras are; it is registered as if they were at one"
                " place, so edges are off by their distance: expected aligned depth, or frames of"
                " their own with a transform in tf"
            )
        registered_m = calib.register_depth(reading.depth_m, depth.camera, camera, transform)
        return DepthReading(registered_m, reading.fault)

    def _fault(self, depth: View, colour: View, *, has_transform: bool) -> DepthReading:
        lacking = "a camera lacks" if has_transform else "tf has no transform between them"
        fault = (
            f"depth of {self._topic} is {depth} and colour {colour}, and {lacking}: expected"
            " aligned depth"
        )
        self._say(fault)
        self._counts[_NOT_ALIGNED] += 1
        return DepthReading(np.zeros(colour.size_px[::-1], np.float32), fault)


def _differ(first: calib.PinholeCamera | None, second: calib.PinholeCamera | None) -> bool:
    """Whether two cameras are known and see a point in different places of their pictures."""
    return first is not None and second is not None and first != second and _far(first, second)


@lru_cache(maxsize=8)
def _far(first: calib.PinholeCamera, second: calib.PinholeCamera) -> bool:
    try:
        first = first.scaled(second.width, second.height)
    except calib.CameraError:  # another aspect ratio
        return True
    sides = [np.linspace(0, side, _GRID) for side in (second.width, second.height)]
    xy_px = np.stack(np.meshgrid(*sides), -1)
    with np.errstate(all="ignore"):
        moved = calib.project_points(second, calib.pixels_to_rays(first, xy_px)) - xy_px
    return not float(np.abs(moved).max()) <= _SAME_LENS_PX
