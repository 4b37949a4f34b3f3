"""Where stems stand without depth: what a way has to know, and what it tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from basetree.arrays import Bool, Float, Index
from calib import pixels_to_rays, project_points
from edgetree.measure.frame import DepthFrame
from edgetree.measure.section import Sections
from edgetree.measure.views import TurnedFrame


@dataclass(frozen=True, eq=False, kw_only=True)
class SeenStems:
    """T stems as a picture shows them, without a scale.

    Attributes:
        numbers: (T,) numbers of the trees in the picture.
        frame: The picture, its camera and the errors of the rig.
        sections: Cross-sections at 1 m from the camera to the axis.
        middle_std_rad: (T,) standard deviations of the directions of their middles.
        foot_px: (T, 2) lowest points of the stems in the picture; NaN where none is seen.
        foot_std_px: (T,) standard deviations of these, up and down.
        foot_above_m, foot_above_std_m: (T,) expected height of these above the ground, and its
            standard deviation.
        foot_within: (T,) whether the foot is in the picture, as far as one can tell.
        along_px: (T, 2) unit vectors up the stems in the picture.
        edges_px: (2, T, S, 2) points on the left and the right edges.
        edges_valid: (2, T, S) which of these are seen.
        up: (T, 3) the vertical at each stem.
        up_covariance: (T, 3, 3) of its error, in rad².
    """

    numbers: Index
    frame: DepthFrame
    sections: Sections
    middle_std_rad: Float
    foot_px: Float
    foot_std_px: Float
    foot_above_m: Float
    foot_above_std_m: Float
    foot_within: Bool
    along_px: Float
    edges_px: Float
    edges_valid: Bool
    up: Float
    up_covariance: Float

    def __len__(self) -> int:
        return len(self.foot_px)

    def picture_rays(self, xy_px: Float) -> Float:
        """Rays (..., 3) with z = 1 in the frame's axes through points (..., 2) of the picture."""
        frame = self.frame
        camera = frame.source.camera if isinstance(frame, TurnedFrame) else frame.camera
        rays = frame.from_camera(pixels_to_rays(camera, xy_px))
        return np.asarray(rays / rays[..., 2:])

    def picture_px(self, xy_px: Float) -> Float:
        """Points (..., 2) of the picture in the pixels of the frame, which may be a view of it."""
        return np.asarray(project_points(self.frame.camera, self.picture_rays(xy_px)))


class Placement(NamedTuple):
    """Distances of T stems, across their axes from the camera to the axis.

    Attributes:
        distance_m: (T,) distances; NaN where there is a reason.
        distance_std: (T,) their relative standard deviations.
        size_std: (T,) relative standard deviations of lengths across the view at the stems. An
            error of the focal length changes a distance and the width in opposite ways.
        anchor_m: (T,) heights along the axes, from the sections, at which the distances are known.
        normal: (T, 3) normals of the ground at the stems, or the vertical where nothing tells them.
        reasons: Why a stem is not placed, or None.
        words: How each distance is known.
        doubts: What most of the error of each comes from; empty where it is not told.
    """

    distance_m: Float
    distance_std: Float
    size_std: Float
    anchor_m: Float
    normal: Float
    reasons: list[str | None]
    words: list[str]
    doubts: list[str]

    def evidence(self, index: int, size_std: float) -> str:
        """How one distance is known, with the relative error of sizes there."""
        doubt = f", most of it from {self.doubts[index]}" if self.doubts[index] else ""
        return f"{self.words[index]}: ± {100 * size_std:.0f} %{doubt}"

    def uncertain(self, index: int) -> str:
        """Why one distance is of no use."""
        doubt = f", mostly because of {self.doubts[index]}" if self.doubts[index] else ""
        return f"the distance by {self.words[index]} is too uncertain{doubt}"


class Way(Protocol):
    """One way to know how far away stems are without depth."""

    def place(self, seen: SeenStems) -> Placement:
        """Place the stems of a picture."""


def best_placement(placements: Sequence[Placement]) -> Placement:
    """Of several ways the one that states the smallest error of sizes, for each stem.

    A stem that none of them places keeps the reason of the first.
    """
    size_std = np.array([each.size_std for each in placements])
    failed = np.array([[why is not None for why in each.reasons] for each in placements])
    best = np.where(failed, np.inf, size_std).argmin(0).tolist()
    columns = range(len(best))

    def picked(name: str) -> Float:
        arrays = [getattr(each, name) for each in placements]
        return np.array([arrays[way][column] for way, column in zip(best, columns, strict=True)])

    return Placement(
        picked("distance_m"),
        picked("distance_std"),
        picked("size_std"),
        picked("anchor_m"),
        picked("normal"),
        [placements[way].reasons[column] for way, column in zip(best, columns, strict=True)],
        [placements[way].words[column] for way, column in zip(best, columns, strict=True)],
        [placements[way].doubts[column] for way, column in zip(best, columns, strict=True)],
    )


def largest_terms(terms: dict[str, Float]) -> list[str]:
    """For each of T stems the term that most of its error comes from.

    Args:
        terms: (T,) relative standard deviations by their words.
    """
    names = list(terms)
    largest = np.array([np.abs(terms[name]) for name in names]).argmax(0)
    return [names[index] for index in largest.tolist()]
