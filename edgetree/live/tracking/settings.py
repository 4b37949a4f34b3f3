"""Assumptions of tracking and fusion about errors, motion and time."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError

__all__ = ["ErrorShares", "TrackingSettings"]


@dataclass(frozen=True)
class ErrorShares:
    """Parts of the error of one view of a stem, as shares of the variance that the view states.

    Their sum is 1 if the stated intervals are right. None of them is negative, and one is positive.

    Attributes:
        bias: the same in all views of a stem. It does not average away.
        view: the same in frames from about the same place.
        noise: independent in every frame.

    Raises:
        InputError: a share is negative, or all are 0.
    """

    bias: float
    view: float
    noise: float

    def __post_init__(self) -> None:
        shares = astuple(self)
        if not all(math.isfinite(share) and share >= 0 for share in shares) or not sum(shares):
            raise InputError(f"the shares of errors are {shares}: expected numbers from 0 on")


@dataclass(frozen=True)
class TrackingSettings:
    """Assumptions of `StemTracker`. All numbers are positive.

    The shares of errors are for an embedded depth model. Those of diameters come from a simulated
    drive with 28 measured stems, scaled to a sum of 1; those of diameters at breast height, of cut
    heights and of inclinations were chosen on nine drives with 229 stems so that the 95 % intervals
    hold after 1, 5 and 20 frames (`benchmarks/tracking.py`). When a better model made the stated
    deviations of single views smaller (of inclinations larger), the shares were scaled so that the
    deviations of tracks stayed the same. Those of positions are assumed.

    Attributes:
        memory_s: a confirmed stem that is not seen is kept for this time, s.
        new_memory_s: a stem that is not confirmed yet is kept for this time, s.
        confirm_frames: frames that must agree until a stem is confirmed.
        gate: largest chi-square of a position, with two degrees of freedom, that counts as the
            same stem.
        far_gate: above `gate` and up to this, a view belongs to the stem but contradicts it, and is
            not fused.
        split_frames: contradicting frames in a row after which they become a stem of their own.
        view_angle_deg: views from directions at least this far apart around the stem are
            distinct.
        view_distance_ratio: views whose distances differ by this factor are distinct.
        diameter: parts of the error of diameters.
        dbh: parts of the error of diameters at breast height.
        cut_height: parts of the error of cut heights.
        inclination: parts of the error of inclinations.
        position: parts of the error of positions.
        border_share: a box that comes nearer to the left or right border of the picture than this
            share of its width may be of a stem that is cut off.
        border_doubt: factor on the stated standard deviations of such a stem.
        min_narrowing: share of the diameter's interval by which another view must narrow it to
            count as a help.
        pose_std_m: standard deviation of given poses, as positions between frames, m.
        pose_std_deg: the same for their heading.
        up_std_deg: standard deviation of given verticals.
        stem_up_std_deg: standard deviation of verticals that are taken from the stems.
        acceleration_m_per_s2: standard deviation of the camera's acceleration.
        turn_acceleration_deg_per_s2: the same for its turns about the vertical.
        speed_m_per_s: standard deviation of the camera's speed before it is known.
        turn_deg_per_s: the same for its turns.
        lost_std_m: without a pose, the camera is lost when its place is less certain than this.

    Raises:
        InputError: a number is not positive.
    """

    memory_s: float = 60.0
    new_memory_s: float = 1.0
    confirm_frames: int = 3
    gate: float = 13.8
    far_gate: float = 40.0
    split_frames: int = 5
    view_angle_deg: float = 10.0
    view_distance_ratio: float = 1.2
    diameter: ErrorShares = ErrorShares(0.40, 0.47, 0.47)
    dbh: ErrorShares = ErrorShares(0.30, 1.20, 0.60)
    cut_height: ErrorShares = ErrorShares(0.38, 0.32, 0.16)
    inclination: ErrorShares = ErrorShares(0.46, 0.23, 0.53)
    position: ErrorShares = ErrorShares(0.2, 0.5, 0.3)
    border_share: float = 0.025
    border_doubt: float = 3.0
    min_narrowing: float = 0.05
    pose_std_m: float = 0.02
    pose_std_deg: float = 0.3
    up_std_deg: float = 0.3
    stem_up_std_deg: float = 3.0
    acceleration_m_per_s2: float = 1.0
    turn_acceleration_deg_per_s2: float = 60.0
    speed_m_per_s: float = 1.5
    turn_deg_per_s: float = 40.0
    lost_std_m: float = 3.0

    @cached_property
    def scalar_shares(self) -> NDArray[np.float64]:
        """(3, 5) shares of bias, view and noise, for the columns of `Sightings.values`."""
        shares = (self.diameter, self.dbh, self.cut_height, self.inclination, self.position)
        return np.array([astuple(share) for share in shares], np.float64).T

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not isinstance(value, ErrorShares) and not (math.isfinite(value) and value > 0):
                raise InputError(f"{field.name} is {value}: expected a positive number")
