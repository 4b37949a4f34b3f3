"""Fuse the views of each stem, with errors that several views share."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float, Index
from edgetree.live.tracking.plane import wrapped
from edgetree.live.tracking.settings import TrackingSettings
from edgetree.live.tracking.sightings import Sightings

# Distinct views that are kept apart for one stem. Later ones count to the nearest of these.
_MAX_VIEWS = 40
# A value further from the fused one than this many standard deviations counts less (Huber).
_HUBER_STDS = 2.5
# Views contradict each other where the chi-square of their means exceeds this, per degree of
# freedom, at one degree: the 99.9 % quantile. `_worst_ratio` tells it for more degrees.
_WORST_CHI_SQUARE = 10.8

FUSED = np.dtype(
    [
        ("angle_rad", np.float64, (_MAX_VIEWS,)),
        ("log_m", np.float64, (_MAX_VIEWS,)),
        ("count", np.float64, (_MAX_VIEWS, 5)),
        ("info", np.float64, (_MAX_VIEWS, 5)),
        ("sums", np.float64, (_MAX_VIEWS, 5)),
        ("line_count", np.float64, (_MAX_VIEWS,)),
        ("line_info", np.float64, (_MAX_VIEWS, 4, 4)),
        ("line_sums", np.float64, (_MAX_VIEWS, 4)),
        ("views", np.intp),
        ("arc_deg", np.float64),
        ("line", np.float64, (4,)),
        ("line_covariance", np.float64, (4, 4)),
        ("values", np.float64, (5,)),
        ("stds", np.float64, (5,)),
        ("next_stds", np.float64, (5,)),
        ("conflict", np.float64, (5,)),
        ("spread", np.float64, (5, 2)),
        ("rig_stds", np.float64, (5,)),
    ]
)
"""What is known of one stem.

- `angle_rad`, `log_m`: direction around the stem and logarithm of the distance, of each view.
- `count`, `info`, `sums`: sums over the frames of each view, for each quantity, of 1, of the
  inverse variance, and of the value times the inverse variance. `line_...` likewise for the line.
- `views`, `arc_deg`: number of distinct views, and angle between the outermost ones.
- `line`, `line_covariance`: fused line as in `Sightings`, in the map, at the height of reference.
- `values`, `stds`: fused quantities; the deviation is infinite where there is none.
- `next_stds`: deviations that one more view like the others would leave.
- `conflict`: chi-square per degree of freedom of the views where it is too large for chance, else
  1. The variances are multiplied by it.
- `spread`: lowest and highest mean of a view.
- `rig_stds`: deviations by the errors of the rig, which all frames share and no view makes
  smaller. `stds` and `next_stds` are without them.
"""


def add_views(
    stems: NDArray[np.void],
    rows: Index,
    seen: Sightings,
    from_m: Float,
    settings: TrackingSettings,
) -> None:
    """Add one frame's view to each of K stems and fuse anew.

    Args:
        stems: (T,) of `FUSED`, changed in place.
        rows: (K,) different indices into `stems`.
        seen: The K sightings, with lines and levels in the map, at the stems' height of reference.
        from_m: (2,) place of the camera in the map.
        settings: What counts as a distinct view, and the shares of errors.
    """
    cells = _cells(stems, rows, seen, from_m, settings)
    fused, stds = stems["values"][rows], stems["stds"][rows]
    known = np.isfinite(seen.stds)
    stems["rig_stds"][rows] = np.maximum(stems["rig_stds"][rows], seen.rig_stds)
    std = np.where(known, seen.stds, 1.0)
    off = np.abs(seen.values - fused) / np.where(np.isfinite(stds), np.hypot(stds, std), np.inf)
    weight = np.where(known, _HUBER_STDS / np.maximum(off, _HUBER_STDS), 0.0)
    stems["count"][rows, cells] += weight
    stems["info"][rows, cells] += weight / std**2
    stems["sums"][rows, cells] += weight * seen.values / std**2
    info = np.linalg.inv(seen.line_covariance)
    stems["line_count"][rows, cells] += 1.0
    stems["line_info"][rows, cells] += info
    stems["line_sums"][rows, cells] += (info @ seen.line[..., None])[..., 0]
    _fuse_values(stems, rows, settings)
    _fuse_lines(stems, rows, settings)


def _cells(
    stems: NDArray[np.void],
    rows: Index,
    seen: Sightings,
    from_m: Float,
    settings: TrackingSettings,
) -> Index:
    """(K,) which view of its stem each sighting belongs to; new ones are begun."""
    back = from_m - seen.line[:, :2]
    angle, log_m = np.arctan2(back[:, 1], back[:, 0]), np.log(np.maximum(np.hypot(*back.T), 0.1))
    views = stems["views"][rows]
    begun = min(int(views.max()) + 1, _MAX_VIEWS)
    turn = stems["angle_rad"][rows, :begun] - angle[:, None]
    turn = np.abs(wrapped(turn)) / np.radians(settings.view_angle_deg)
    nearer = np.abs(stems["log_m"][rows, :begun] - log_m[:, None]) / np.log(
        settings.view_distance_ratio
    )
    apart = np.where(np.arange(begun) < views[:, None], np.maximum(turn, nearer), np.inf)
    cells = apart.argmin(1)
    new = (apart[np.arange(len(rows)), cells] > 1.0) & (views < _MAX_VIEWS)
    cells = np.where(new, views, cells)
    if new.any():
        stems["angle_rad"][rows[new], cells[new]] = angle[new]
        stems["log_m"][rows[new], cells[new]] = log_m[new]
        stems["views"][rows[new]] += 1
        for row in rows[new]:
            stems["arc_deg"][row] = _arc_deg(stems["angle_rad"][row, : stems["views"][row]])
    return cells


def _arc_deg(angles_rad: Float) -> float:
    """Smallest arc that holds all angles."""
    ordered = np.sort(angles_rad % (2 * np.pi))
    gaps = np.diff(ordered, append=ordered[0] + 2 * np.pi)
    return float(np.degrees(2 * np.pi - gaps.max()))


def _fuse_values(stems: NDArray[np.void], rows: Index, settings: TrackingSettings) -> None:
    """Fuse the scalar quantities of some stems.

    The error of a frame, in units of its stated deviation, is a bias of the stem, an error of the
    view and noise of the frame, with the variances b, v and n of `ErrorShares`. The mean of N
    frames with the deviation s has the variance s² (v + n / N) beside the bias. The means of
    distinct views are averaged with the inverse of s² (b + v + n / N). The bias has the same sign
    in all views, so it is averaged as a deviation.
    """
    bias, view, noise = settings.scalar_shares
    most = int(stems["views"][rows].max())
    count, info = stems["count"][rows, :most], stems["info"][rows, :most]
    given = info > 0
    info = np.where(given, info, 1.0)
    variance = count / info
    within = variance * (view + noise / np.maximum(count, 1.0))
    means = stems["sums"][rows, :most] / info
    weight = np.where(given, 1.0 / np.maximum(bias * variance + within, 1e-12), 0.0)
    total = weight.sum(1)
    known = total > 0
    total = np.where(known, total, 1.0)
    value = (weight * means).sum(1) / total
    shared = bias * ((weight * np.sqrt(variance)).sum(1) / total) ** 2
    rest = (weight**2 * within).sum(1) / total**2
    degrees = given.sum(1) - 1
    chi_square = np.where(given, (means - value[:, None]) ** 2 / np.maximum(within, 1e-12), 0.0)
    ratio = chi_square.sum(1) / np.maximum(degrees, 1)
    conflict = np.where((degrees > 0) & (ratio > _worst_ratio(degrees)), ratio, 1.0)
    # One more view of the same kind adds its share to the weights.
    views = np.maximum(degrees + 1, 1)
    stems["values"][rows] = np.where(known, value, 0.0)
    stems["stds"][rows] = np.where(known, np.sqrt((shared + rest) * conflict), np.inf)
    following = (shared + rest * views / (views + 1)) * conflict
    stems["next_stds"][rows] = np.where(known, np.sqrt(following), np.inf)
    stems["conflict"][rows] = conflict
    lowest = np.where(given, means, np.inf).min(1)
    highest = np.where(given, means, -np.inf).max(1)
    stems["spread"][rows] = np.stack([lowest, highest], -1)


def _worst_ratio(degrees: Index) -> Float:
    """99.9 % quantile of chi-square per degree of freedom (Wilson and Hilferty's approximation)."""
    part = 2.0 / (9.0 * np.maximum(degrees, 1))
    return np.asarray(np.minimum((1 - part + 3.09 * np.sqrt(part)) ** 3, _WORST_CHI_SQUARE))


def _fuse_lines(stems: NDArray[np.void], rows: Index, settings: TrackingSettings) -> None:
    """Fuse the lines of some stems, by the same rule with covariance matrices."""
    share = settings.position
    most = int(stems["views"][rows].max())
    count, info = stems["line_count"][rows, :most], stems["line_info"][rows, :most]
    each = np.where(count > 0, 1.0 / (share.view * count + share.noise), 0.0)
    total = (each[..., None, None] * info).sum(1)
    covariance = np.linalg.inv(total)
    sums = (each[..., None] * stems["line_sums"][rows, :most]).sum(1)
    stems["line"][rows] = (covariance @ sums[..., None])[..., 0]
    frames = count.sum(1)[:, None, None]
    stems["line_covariance"][rows] = covariance + share.bias * frames * np.linalg.inv(info.sum(1))
