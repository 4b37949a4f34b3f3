"""Match sightings with followed stems, and find the camera's place by them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float
from basetree.matching import match_greedily
from edgetree.live.tracking.motion import CameraMotion
from edgetree.live.tracking.plane import chi_squares, determinants
from edgetree.live.tracking.registration import find_place, refine_place
from edgetree.live.tracking.sightings import DIAMETER, Sightings
from edgetree.live.tracking.stems import StemMap

# Largest part of a difference of diameters in the cost of a match, as a chi-square: diameters
# decide between stems that are near each other, but refuse none.
_MAX_DIAMETER_COST = 9.0
# Added to the cost of a match with a stem that is not confirmed, and with one that the last frame
# did not show, as chi-squares.
_NEW_COST, _UNSEEN_COST = 4.0, 4.0
# Diameters further apart than this many standard deviations are of different stems, in a search
# without a prediction.
_MAX_DIAMETER_STDS = 3.0
# Where the prediction is less certain than this at a stem, m, stems may be taken for their
# neighbours, and all are matched together.
_AMBIGUOUS_M = 0.5
_REFINEMENTS = 2
# A place that is corrected by less than this, m, at a stem this far away, needs no second matching.
_SAME_PLACE_M, _TYPICAL_RANGE_M = 0.1, 7.0


def match_costs(stems: StemMap, seen: Sightings) -> tuple[Float, Float]:
    """Costs of matching stems with sightings in the map, and chi-squares of their places.

    The logarithm of a match's probability density, times -2 and without what all matches share:
    with the covariances S of a stem's place and R of a sighting's, their offset d and the
    difference of diameters e with its standard deviation s, the cost is
    d' (S + R)^-1 d + ln(det(S + R) / det(R)) + min((e / s)^2, `_MAX_DIAMETER_COST`).

    Returns:
        (T, M) costs and (T, M) chi-squares, the first term of them.
    """
    rows = stems.rows
    own = seen.line_covariance[:, :2, :2]
    total = _spreads(rows, seen.point_m[:, 2]) + own
    chi_square = chi_squares(stems.places_at(seen) - seen.point_m[:, :2], total)
    vague = np.log(determinants(total) / determinants(own))
    off_m = rows["values"][:, None, DIAMETER] - seen.values[:, DIAMETER]
    std_m = np.hypot(rows["stds"][:, None, DIAMETER], seen.stds[:, DIAMETER])
    cost = chi_square + vague + np.minimum((off_m / std_m) ** 2, _MAX_DIAMETER_COST)
    extra = np.where(stems.confirmed, 0.0, _NEW_COST)
    extra = extra + np.where(rows["missed"] > 1, _UNSEEN_COST, 0.0)
    return cost + extra[:, None], chi_square


def _spreads(rows: NDArray[np.void], height_m: Float) -> Float:
    """(T, M, 2, 2) covariances of the places of stems at M heights."""
    lines = rows["line_covariance"]
    place, slope = lines[:, :2, :2], lines[:, 2:, 2:]
    cross = lines[:, :2, 2:] + lines[:, 2:, :2]
    rise = (height_m - rows["reference_m"][:, None])[..., None, None]
    return np.asarray(place[:, None] + rise * cross[:, None] + rise**2 * slope[:, None])


def locate(motion: CameraMotion, stems: StemMap, seen: Sightings, lost: bool, gate: float) -> bool:
    """Correct the predicted place of the camera by the stems that it sees.

    Args:
        motion: The prediction; corrected in place. With no match it stays.
        stems: The followed stems.
        seen: Sightings in the level frame.
        lost: Whether the prediction is worthless.
        gate: Largest chi-square of a match.

    Returns:
        False if the prediction is worthless and the stems do not tell the place.
    """
    predicted = motion.state, motion.covariance
    if lost or _reach_std_m(motion, seen) > _AMBIGUOUS_M:
        place = _search(motion, stems, seen, lost)
        if place is not None:
            motion.take_found(place)
            predicted = (motion.state, motion.covariance) if lost else predicted
        elif lost:
            return False
    rows = columns = np.zeros(0, np.intp)
    for _ in range(_REFINEMENTS):
        in_map = seen.in_map(motion)
        cost, chi_square = match_costs(stems, in_map)
        before, (rows, columns) = (rows, columns), match_greedily(cost, chi_square <= gate)
        if not len(rows):
            return True
        if np.array_equal(before, (rows, columns)):
            break
        matched = seen.select(columns)
        places, spread = stems.at_height(rows, matched.point_m[:, 2] + motion.height_m)
        spreads = (spread, matched.line_covariance[:, :2, :2])
        state, covariance = refine_place(
            predicted, motion.state, places, matched.line[:, :2], spreads
        )
        change = np.abs(state[:3] - motion.state[:3])
        motion.set_place(state, covariance)
        if max(change[0], change[1], change[2] * _TYPICAL_RANGE_M) < _SAME_PLACE_M:
            break
    stems.level_camera(rows, seen.select(columns), motion)
    return True


def _reach_std_m(motion: CameraMotion, seen: Sightings) -> float:
    """Standard deviation of the predicted place of a seen stem, over all of them."""
    jacobian = motion.place_jacobian(seen.point_m[:, :2])
    spread = jacobian @ motion.covariance[:3, :3] @ jacobian.transpose(0, 2, 1)
    return math.sqrt(float(np.trace(spread, axis1=1, axis2=2).mean()))


def _search(motion: CameraMotion, stems: StemMap, seen: Sightings, lost: bool) -> Float | None:
    """Search for the camera's place by all stems together, as `find_place`."""
    rows = stems.rows
    theirs, ours = rows["stds"][:, DIAMETER], seen.stds[:, DIAMETER]
    off_m = np.abs(rows["values"][:, None, DIAMETER] - seen.values[:, DIAMETER])
    alike = ~(off_m > _MAX_DIAMETER_STDS * np.hypot(theirs[:, None], ours))
    return find_place(
        motion,
        rows["line"][:, :2],
        _level_std_m(rows["line_covariance"]),
        seen.line[:, :2],
        _level_std_m(seen.line_covariance),
        alike,
        lost=lost,
    )


def _level_std_m(covariance: Float) -> Float:
    """(N,) standard deviations of a level coordinate, from (N, 4, 4)."""
    return np.asarray(np.sqrt((covariance[:, 0, 0] + covariance[:, 1, 1]) / 2))
