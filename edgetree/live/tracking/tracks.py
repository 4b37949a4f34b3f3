"""The stems that are followed over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from basetree.arrays import Float
from edgetree.measure import Estimate, Failure, PointEstimate


@dataclass(frozen=True, eq=False, kw_only=True)
class TreeTrack:
    """A stem that is followed over time, with what all views of it say together.

    Attributes:
        number: Number of the stem, the same as long as it is followed.
        tree: Index of the stem among the trees of this frame; None if it is not seen in it.
        state: "new" until enough views agree, then "confirmed".
        position_m: Where the stem's axis meets the ground or the cut, in the map (x and y level,
            z up). The map is the frame of the source's poses, or else the first camera's place.
        position_camera_m: (3,) the same point in the camera's frame.
        diameter_m: Diameter at the felling cut.
        dbh_m: Diameter at breast height.
        cut_height_m: Height of the felling cut above the ground.
        inclination_deg: Angle of the axis from the vertical.
        frames: Number of frames that the stem was measured in.
        views: Number of distinct views among them, which are what the intervals rest on.
        arc_deg: Angle around the stem between the outermost views.
        more_views_help: Whether another view would make the diameter's interval clearly narrower.
        last_seen_s: Time stamp of the last frame that shows it, s.
        map_part: Number of the map, from 1 on; places in different maps have nothing in common.
        absorbed: Numbers of confirmed stems that turned out to be this one.
        warnings: Contradictions between the views, and where the map or the stem began anew.
    """

    number: int
    tree: int | None
    state: Literal["new", "confirmed"]
    position_m: PointEstimate
    position_camera_m: Float
    diameter_m: Estimate | Failure
    dbh_m: Estimate | Failure
    cut_height_m: Estimate | Failure
    inclination_deg: Estimate | Failure
    frames: int
    views: int
    arc_deg: float
    more_views_help: bool
    last_seen_s: float
    map_part: int = 1
    absorbed: tuple[int, ...] = ()
    warnings: tuple[str, ...] = ()
