"""The exact geometry of a cylinder seen from near, on the plane across its axis.

Seen along its axis a cylinder is a circle, the camera a point, and every ray a direction in that
plane. The two rays that graze the stem's edges are tangents of the circle; with half the angle
between them, delta, and the distance d from camera to axis in the plane, the radius is
d sin(delta). A ray at angle theta from the middle meets the front of the circle at
d (cos(theta) - sqrt(sin²(delta) - sin²(theta))); in the middle that is the front range
rho = d (1 - sin(delta)), so the diameter is 2 rho sin(delta) / (1 - sin(delta)).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["AxisFrame", "Section", "axis_frame", "tangent_section"]

Float = NDArray[np.floating[Any]]


@dataclass(frozen=True, eq=False)
class AxisFrame:
    """Unit vectors (3,) at a stem: `along` its axis upwards, `across` it to the right as seen,
    and `away` from the camera, both at right angles to the axis.
    """

    along: Float
    across: Float
    away: Float

    def tilted(self, tangent: float) -> AxisFrame:
        """With the axis tilted away from the camera by an angle of this tangent."""
        length = float(np.hypot(1.0, tangent))
        return AxisFrame(
            (self.along + tangent * self.away) / length,
            self.across,
            (self.away - tangent * self.along) / length,
        )


def axis_frame(normal: Float, up: Float) -> AxisFrame:
    """The frame whose axis lies in the plane with `normal` (3,) through the camera, nearest to
    `up` (3,). `across` is the normal turned to the right of an upright camera's image.
    """
    along = up - (up @ normal) * normal
    along = along / np.linalg.norm(along)
    away = np.cross(along, normal)
    if away[2] < 0:
        normal, away = -normal, -away
    return AxisFrame(along, normal, away)


@dataclass(frozen=True, eq=False)
class Section:
    """A stem in the plane across its axis.

    Attributes:
        frame: the axis.
        middle_rad: bearing of the stem's middle, from `frame.away` towards `frame.across`.
        half_angle_rad: delta, half the angle between the tangent rays.
        height: how far up the axis the section lies, per metre of distance from the camera to
            the axis.
    """

    frame: AxisFrame
    middle_rad: float
    half_angle_rad: float
    height: float

    @property
    def front_share(self) -> float:
        """Front range per distance to the axis: 1 - sin(delta)."""
        return 1.0 - float(np.sin(self.half_angle_rad))

    @property
    def centre(self) -> Float:
        """(3,) axis point of the section for a distance of 1 m from the camera to the axis."""
        frame = self.frame
        return np.asarray(
            np.cos(self.middle_rad) * frame.away
            + np.sin(self.middle_rad) * frame.across
            + self.height * frame.along
        )

    def look(self, rays: Float) -> tuple[Float, Float, Float]:
        """How (N, 3) rays with z = 1 see the stem.

        Returns:
            offset: (N,) sin(theta) / sin(delta), -1 and 1 at the edges.
            depth_share: (N,) depth z of the front per metre from the camera to the axis; only
                where |offset| < 1, else 0.
            height: (N,) height along the axis of the axis point behind the ray, in the same share.
        """
        frame = self.frame
        cos, sin = np.cos(self.middle_rad), np.sin(self.middle_rad)
        ahead = rays @ (cos * frame.away + sin * frame.across)
        aside = rays @ (cos * frame.across - sin * frame.away)
        squared_reach = ahead**2 + aside**2
        edge = np.sin(self.half_angle_rad)
        offset = aside / (edge * np.sqrt(squared_reach))
        inside = (np.abs(offset) < 1) & (ahead > 0)
        behind = edge * np.sqrt(np.where(inside, (1 - offset**2) * squared_reach, 0.0))
        share = np.where(inside, (ahead - behind) / squared_reach, 0.0)
        return offset, share, (rays @ frame.along) * share


def bearing_rad(frame: AxisFrame, rays: Float) -> Float:
    """(...) angle of (..., 3) rays in the plane across the axis, from `away` towards `across`."""
    return np.asarray(np.arctan2(rays @ frame.across, rays @ frame.away))


def tangent_section(frame: AxisFrame, left_ray: Float, right_ray: Float) -> Section:
    """The section whose edges are grazed by two rays (3,); the order does not matter."""
    edges = bearing_rad(frame, np.stack([left_ray, right_ray]))
    middle = float(edges.mean())
    half = float(abs(edges[1] - edges[0]) / 2)
    slopes = [
        float(ray @ frame.along) / float(np.hypot(ray @ frame.across, ray @ frame.away))
        for ray in (left_ray, right_ray)
    ]
    # The tangent points lie at d cos(delta), and both on the section.
    return Section(frame, middle, half, float(np.mean(slopes)) * float(np.cos(half)))
