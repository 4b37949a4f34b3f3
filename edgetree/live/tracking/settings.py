"""Assumptions of tracking and fusion about errors, motion and time."""

from __future__ import annotations

import math
from dataclasses import astuple, dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from basetree.settings import Settings, limits

_POSITIVE = limits(over=0, expected="a positive number")


@dataclass(frozen=True)
class ErrorShares(Settings, error=InputError):
    """Parts of the error of one view of a stem, as shares of the variance that the view states.

    Their sum is 1 if the stated intervals are right. None of them is negative, and one is positive.
    """

    bias: float
    """The same in all views of a stem. It does not average away."""
    view: float
    """The same in frames from about the same place."""
    noise: float
    """Independent in every frame."""

    def _check_together(self) -> None:
        shares = astuple(self)
        if not all(math.isfinite(share) and share >= 0 for share in shares) or not sum(shares):
            self._refuse(f"the shares of errors are {shares}", "numbers from 0 on")


@dataclass(frozen=True)
class TrackingSettings(Settings, each=_POSITIVE, error=InputError):
    """Assumptions of `StemTracker`. All numbers are positive.

    The shares of errors are for an embedded depth model. Those of diameters come from a simulated
    drive with 28 measured stems, scaled to a sum of 1; those of diameters at breast height, of cut
    heights and of inclinations were chosen on nine drives with 229 stems so that the 95 % intervals
    hold after 1, 5 and 20 frames (`benchmarks/tracking.py`). A later model
    states smaller deviations for single views (larger ones of inclinations). The shares were then
    scaled, so that the deviations of tracks stayed the same. Those of positions are assumed.
    """

    memory_s: float = 60.0
    """A confirmed stem that is not seen is kept for this time, s."""
    new_memory_s: float = 1.0
    """A stem that is not confirmed yet is kept for this time, s."""
    confirm_frames: int = 3
    """Frames that must agree until a stem is confirmed."""
    gate: float = 13.8
    """Largest chi-square of a position, with two degrees of freedom, that counts as the same
    stem."""
    far_gate: float = 40.0
    """Above `gate` and up to this, a view belongs to the stem but contradicts it, and is not
    fused."""
    split_frames: int = 5
    """Contradicting frames in a row after which they become a stem of their own."""
    view_angle_deg: float = 10.0
    """Views from directions at least this far apart around the stem are distinct."""
    view_distance_ratio: float = 1.2
    """Views whose distances differ by this factor are distinct."""
    diameter: ErrorShares = ErrorShares(0.40, 0.47, 0.47)
    """Parts of the error of diameters."""
    dbh: ErrorShares = ErrorShares(0.30, 1.20, 0.60)
    """Parts of the error of diameters at breast height."""
    cut_height: ErrorShares = ErrorShares(0.38, 0.32, 0.16)
    """Parts of the error of cut heights."""
    inclination: ErrorShares = ErrorShares(0.46, 0.23, 0.53)
    """Parts of the error of inclinations."""
    position: ErrorShares = ErrorShares(0.2, 0.5, 0.3)
    """Parts of the error of positions."""
    border_share: float = 0.025
    """A box that comes nearer to the left or right border of the picture than this share of its
    width may be of a stem that is cut off."""
    border_doubt: float = 3.0
    """Factor on the stated standard deviations of such a stem."""
    min_narrowing: float = 0.05
    """Share of the diameter's interval by which another view must narrow it to count as a help."""
    pose_std_m: float = 0.02
    """Standard deviation of given poses, as positions between frames, m."""
    pose_std_deg: float = 0.3
    """The same for their heading."""
    up_std_deg: float = 0.3
    """Standard deviation of given verticals."""
    stem_up_std_deg: float = 3.0
    """Standard deviation of verticals that are taken from the stems."""
    acceleration_m_per_s2: float = 1.0
    """Standard deviation of the camera's acceleration."""
    turn_acceleration_deg_per_s2: float = 60.0
    """The same for its turns about the vertical."""
    speed_m_per_s: float = 1.5
    """Standard deviation of the camera's speed before it is known."""
    turn_deg_per_s: float = 40.0
    """The same for its turns."""
    lost_std_m: float = 3.0
    """Without a pose, the camera is lost when its place is less certain than this."""

    @cached_property
    def scalar_shares(self) -> NDArray[np.float64]:
        """(3, 5) shares of bias, view and noise, for the columns of `Sightings.values`."""
        shares = (self.diameter, self.dbh, self.cut_height, self.inclination, self.position)
        return np.array([astuple(share) for share in shares], np.float64).T
