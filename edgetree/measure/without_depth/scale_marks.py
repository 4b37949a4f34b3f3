"""Distances of stems from marks of known length on or beside them: markers and scale bars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from basetree.arrays import Float
from basetree.errors import InputError
from edgetree.measure.constants.placing import (
    BAR_END_STD_PX,
    BAR_LEAN_STD_DEG,
    BAR_TURN_STD,
    CORNER_STD_PX,
    MARK_BESIDE_STD_M,
    MARK_ON_STEM_STD_M,
    MARK_SIZE_STD,
)
from edgetree.measure.settings import reference_px
from edgetree.measure.without_depth.placement import Placement, SeenStems

# A mark on a stem has its middle within this many half widths of the stem's own.
_ON_STEM = 1.0
# One beside it is at most this many half widths, or its own lengths, from the stem's edge.
_BESIDE_WIDTHS, _BESIDE_LENGTHS = 6.0, 1.0
_LARGEST_LENGTH_M = 20.0


@dataclass(frozen=True, eq=False)
class ScaleMark:
    """A mark of known length in a picture.

    Attributes:
        points_px: (4, 2) corners of a square, clockwise in the picture from any of them, as
            `cv2.aruco` gives them; or (2, 2) ends of a bar.
        length_m: Side of the square, or length of the bar, in metres.
        name: What messages call it.

    Raises:
        InputError: The length is out of range, or the points are no such ones or not apart.
    """

    points_px: Float
    length_m: float
    name: str

    def __post_init__(self) -> None:
        if not 0 < self.length_m <= _LARGEST_LENGTH_M:
            raise InputError(
                f"the length of {self.name} is {self.length_m:g}: expected metres above 0, up to"
                f" {_LARGEST_LENGTH_M:g}"
            )
        points_px = np.asarray(self.points_px, np.float64)
        if points_px.shape not in ((4, 2), (2, 2)):
            raise InputError(
                f"the points of {self.name} have shape {points_px.shape}: expected (4, 2) corners"
                " or (2, 2) ends"
            )
        object.__setattr__(self, "points_px", points_px)
        sides = np.roll(points_px, -1, axis=0) - points_px
        following = np.roll(sides, -1, axis=0)
        turns = sides[:, 0] * following[:, 1] - sides[:, 1] * following[:, 0]
        if len(points_px) == 4 and np.isfinite(turns).all() and not (turns > 0).all():
            raise InputError(
                f"the corners of {self.name} are {points_px.tolist()}: expected those of a square,"
                " clockwise in the picture"
            )
        if not (np.isfinite(points_px).all() and self.length_px > 1):
            raise InputError(f"the ends of {self.name} are at one place: expected them apart")

    @property
    def length_px(self) -> float:
        """Its length in the picture: of a square that of its longest side."""
        steps = np.roll(self.points_px, -1, axis=0) - self.points_px
        return float(np.linalg.norm(steps, axis=1).max())

    def place(self, seen: SeenStems, index: int) -> tuple[Float, float]:
        """Place the mark.

        The ends of a bar are taken to be equally far ahead, in the plane along the stem and across
        the view of it: a camera that looks down sees an upright bar shorter than one across its
        line of sight.

        Args:
            seen: The stems.
            index: That of the stem which it is on or beside.

        Returns:
            (3,) its middle in the frame's axes, and the relative deviation of its distance.
        """
        rays = seen.picture_rays(self.points_px)
        if len(rays) == 2:
            ahead = rays @ seen.sections.view_direction[index]
            ends = rays / np.where(ahead > 0, ahead, np.nan)[:, None]
            middle, bar = ends.mean(0), ends[1] - ends[0]
            length = float(np.linalg.norm(bar))
            std_px = BAR_END_STD_PX * reference_px(seen.frame.camera.width)
            share = math.sqrt(2) * std_px / self.length_px
            # Its far end is seen nearer to the horizon, or nearer to the middle of the stem.
            turned = math.radians(BAR_LEAN_STD_DEG) * abs(float(bar @ middle)) / length
            std = math.hypot(share, MARK_SIZE_STD, BAR_TURN_STD, turned)
            return middle * self.length_m / length, std
        half_m = self.length_m / 2
        square = half_m * np.array([[-1.0, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]])
        _, _, middle_m = cv2.solvePnP(
            square, rays[:, None, :2], np.eye(3), np.zeros(4), flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        share = CORNER_STD_PX / self.length_px
        return np.asarray(middle_m, np.float64).ravel(), math.hypot(share, MARK_SIZE_STD)


@dataclass(frozen=True, eq=False)
class ScaleMarks:
    """Marks in one picture; each tells the distance of the stem that it is on, or else next to.

    Attributes:
        marks: The marks.
        missing: Why a stem has no distance, if no mark is on or beside it.
    """

    marks: Sequence[ScaleMark]
    missing: str

    def place(self, seen: SeenStems) -> Placement:
        """Place the stems with marks; see `SeenStems`."""
        count = len(seen)
        distance_m, anchor_m = np.full(count, np.nan), np.zeros(count)
        own_std, words = np.full(count, np.inf), [""] * count
        reasons: list[str | None] = [self.missing] * count
        sections = seen.sections
        half = np.sin(sections.half_rad)
        for mark in self.marks:
            index, aside = _stem_of(mark, seen)
            if index is None:
                continue
            middle_m, share = mark.place(seen, index)
            front_m = float(middle_m @ sections.view_direction[index])
            on_stem, where = abs(aside) <= _ON_STEM, "beside"
            radius_m = front_m * half.item(index) / sections.front_ratio.item(index)
            off_m = MARK_BESIDE_STD_M
            if on_stem:
                # To the side of the middle, the bark lies behind the front of the stem.
                front_m -= radius_m * (1 - math.sqrt(1 - min(abs(aside), 1.0) ** 2))
                off_m, where = MARK_ON_STEM_STD_M, "on"
            std = math.hypot(share, off_m / max(front_m, 1e-6))
            # A pose that OpenCV cannot find is NaN, which no comparison holds for.
            if not (front_m > 0 and std < own_std[index]):
                continue
            distance_m[index] = front_m / sections.front_ratio[index]
            along_m = float(middle_m @ sections.axes.along[index])
            anchor_m[index] = along_m - distance_m[index] * sections.height_ratio[index]
            own_std[index], reasons[index] = std, None
            words[index] = f"{mark.name} {where} the stem"
        focal = seen.frame.rig.focal
        distance_std = np.hypot(own_std, focal)
        told = (reasons, words, [""] * count)
        return Placement(distance_m, distance_std, own_std, anchor_m, seen.up, *told)


def _stem_of(mark: ScaleMark, seen: SeenStems) -> tuple[int | None, float]:
    """The stem that a mark is on or nearest to, and how far from its middle, in half widths."""
    middle_px = seen.picture_px(mark.points_px).mean(0)
    best: tuple[int | None, float] = None, math.inf
    least_px = math.inf
    for index in range(len(seen)):
        left, right = seen.edges_px[:, index]
        both = np.flatnonzero(seen.edges_valid[:, index].all(0))
        if not len(both):
            continue
        centres = (left[both] + right[both]) / 2
        nearest = int(np.linalg.norm(centres - middle_px, axis=1).argmin())
        across = right[both[nearest]] - left[both[nearest]]
        half_px = float(np.linalg.norm(across)) / 2
        off = middle_px - centres[nearest]
        aside_px = float(off @ across) / (2 * half_px)
        along_px = float(off @ seen.along_px[index])
        gap_px = max(abs(aside_px) - half_px, 0.0)
        far_px = max(_BESIDE_WIDTHS * half_px, _BESIDE_LENGTHS * mark.length_px)
        if gap_px + abs(along_px) < min(far_px, least_px):
            least_px = gap_px + abs(along_px)
            best = index, aside_px / half_px
    return best
