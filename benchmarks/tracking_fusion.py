"""Errors and intervals of fused measurements against the number of views, and their parts."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterable
from typing import Any

import numpy as np

from benchmarks.tracking_drives import DriveFrame
from edgetree.live.tracking import TrackingSettings, TreeTrack
from edgetree.measure import Estimate, Failure

# Quantity of a track -> label with its true value.
TRUTHS = {
    "diameter_m": "diameter_m",
    "dbh_m": "diameter_breast_m",
    "cut_height_m": "cut_height_m",
    "inclination_deg": "inclination_deg",
}
PLACE = "place_m"
FRAMES = (1, 5, 20, 100)
VIEWS = (1, 2, 4, 8, 16)

# Errors beyond this many stated standard deviations are mistakes of the network, such as another
# stem's edge, which the fusion weighs down. In the fit they count as this much.
_LARGEST = 4.0
# A fitted share is at least this.
_SMALLEST_SHARE = 0.01

Row = tuple[int, int, float, float, int]
"""Frames, distinct views, error and stated standard deviation of a fused value, and the stem."""


def fused_rows(
    drive: list[DriveFrame], tracks: list[list[TreeTrack]], quantity: str
) -> dict[int, list[Row]]:
    """What each followed stem of a drive says whenever it is seen, by the stem's number.

    A followed stem is taken for the labelled one that it is matched to most often; those that are
    rarely a labelled stem are left out.
    """
    truth: dict[int, float] = {}
    stems: dict[int, Counter[int]] = defaultdict(Counter)
    seen: Counter[int] = Counter()
    for frame, followed in zip(drive, tracks, strict=True):
        for track in followed:
            if track.tree is not None:
                seen[track.number] += 1
                if track.tree in frame.label_of:
                    label = frame.labels[frame.label_of[track.tree]]
                    stems[track.number][label["stem"]] += 1
                    true = _truth(label, quantity)
                    if true is not None:
                        truth[label["stem"]] = true
    rows: dict[int, list[Row]] = defaultdict(list)
    for followed in tracks:
        for track in followed:
            value = _value(track, quantity)
            counts = stems[track.number].most_common(1)
            if track.tree is None or not isinstance(value, Estimate) or not counts:
                continue
            stem, count = counts[0]
            if stem in truth and 2 * count > seen[track.number]:
                error = value.value - truth[stem]
                rows[track.number].append((track.frames, track.views, error, value.std, stem))
    return rows


def _value(track: TreeTrack, quantity: str) -> Estimate | Failure:
    """A fused quantity of a track; its place counts as its first coordinate in the map."""
    if quantity == PLACE:
        return Estimate(float(track.position_m.xyz_m[0]), float(track.position_m.std_m[0]))
    value: Estimate | Failure = getattr(track, quantity)
    return value


def _truth(label: dict[str, Any], quantity: str) -> float | None:
    true = label["position_world_m"][0] if quantity == PLACE else label.get(TRUTHS[quantity])
    return None if true is None else float(true)


def coverage(followed: Iterable[list[Row]]) -> dict[str, Any]:
    """RMSE, bias and coverage of the 95 % intervals at numbers of frames and of distinct views.

    Several runs over one drive give several rows of one stem. Each stem counts as much as another,
    and once in the binomial interval. The normalised RMS is that of the errors over their stated
    standard deviations: 1 if the errors are as large as stated.
    """
    followed = list(followed)
    result: dict[str, Any] = {"frames": {}, "views": {}}
    for column, (name, numbers) in enumerate((("frames", FRAMES), ("views", VIEWS))):
        for number in numbers:
            picked = [
                next((row for row in rows if row[column] >= number), None) for rows in followed
            ]
            kept = [row for row in picked if row is not None]
            if kept:
                _, _, error, std, stem = np.array(kept).T
                result[name][str(number)] = _summary(error, std, stem)
    return result


def _summary(error: np.ndarray, std: np.ndarray, stem: np.ndarray) -> dict[str, Any]:
    stems, which, count = np.unique(stem, return_inverse=True, return_counts=True)
    weight = 1 / count[which] / len(stems)
    rmse, stated = (math.sqrt((weight * each**2).sum()) for each in (error, std))
    held = float((weight * (np.abs(error) <= 1.96 * std)).sum())
    return {
        "stems": len(stems),
        "values": len(error),
        "rmse": _rounded(rmse),
        "median_abs": _rounded(np.median(np.abs(error))),
        "bias": _rounded((weight * error).sum()),
        "stated_rms": _rounded(stated),
        "rmse_over_stated": _rounded(rmse / stated),
        "normalised_rms": _rounded(math.sqrt((weight * (error / std) ** 2).sum())),
        "held": _rounded(held),
        "held_interval95": [_rounded(end) for end in binomial95(held, len(stems))],
    }


def binomial95(share: float, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    z = 1.96
    middle = (share + z**2 / (2 * count)) / (1 + z**2 / count)
    half = z * math.sqrt(share * (1 - share) / count + z**2 / (4 * count**2)) / (1 + z**2 / count)
    return middle - half, middle + half


def single_frames(drives: Iterable[list[DriveFrame]]) -> dict[str, Any]:
    """Coverage of the intervals of single frames: of all, and of stems at the picture's border.

    The border is that of `TrackingSettings.border_share`.
    """
    held: dict[str, list[bool]] = {"all": [], "border": [], "elsewhere": []}
    for drive in drives:
        for frame in drive:
            for tree, index in frame.label_of.items():
                value = frame.measurements[tree].diameter_m
                if isinstance(value, Estimate):
                    error = value.value - frame.labels[index]["diameter_m"]
                    place = "border" if _at_border(frame, tree) else "elsewhere"
                    for name in ("all", place):
                        held[name].append(abs(error) <= 1.96 * value.std)
    return {
        name: {"values": len(each), "held": _rounded(float(np.mean(each)))}
        for name, each in held.items()
        if each
    }


def _at_border(frame: DriveFrame, tree: int) -> bool:
    near = TrackingSettings().border_share
    x0, x1 = frame.trees.boxes_px[tree, [0, 2]] / frame.trees.image_width
    return bool(x0 < near or x1 > 1 - near)


def best_single_frame(
    drive: list[DriveFrame], tracks: list[list[TreeTrack]]
) -> list[tuple[float, float, float, float]]:
    """Diameter errors and deviations: of each stem's most certain frame, and fused at the end."""
    singles: dict[int, tuple[float, float]] = {}
    for frame, followed in zip(drive, tracks, strict=True):
        for track in followed:
            if track.tree is None or track.tree not in frame.label_of:
                continue
            label = frame.labels[frame.label_of[track.tree]]
            single = frame.measurements[track.tree].diameter_m
            if isinstance(single, Estimate):
                best = singles.get(track.number)
                if best is None or single.std < best[1]:
                    singles[track.number] = (single.value - label["diameter_m"], single.std)
    fused = fused_rows(drive, tracks, "diameter_m")
    return [
        (*singles[number], *rows[-1][2:4])
        for number, rows in fused.items()
        if number in singles and rows[-1][0] >= FRAMES[1]
    ]


def error_shares(drives: Iterable[list[DriveFrame]], quantity: str) -> dict[str, Any]:
    """Parts of the error of single frames, in units of their stated variance.

    A variance-components fit by moments of pairs: for errors z in units of the stated standard
    deviation, the mean of z² is bias + view + noise, the mean product of two frames of one view of
    a stem is bias + view, and that of two distinct views is bias. Each stem counts by its number of
    frames.
    """
    settings = TrackingSettings()
    sums = np.zeros((3, 2))
    stems = frames = 0
    for drive in drives:
        for errors in _standard_errors(drive, quantity).values():
            z, angle, log_m = np.array(errors).T
            z = np.clip(z, -_LARGEST, _LARGEST)
            first, second = np.triu_indices(len(z), 1)
            turn = np.abs((angle[first] - angle[second] + np.pi) % (2 * np.pi) - np.pi)
            apart = np.maximum(
                turn / np.radians(settings.view_angle_deg),
                np.abs(log_m[first] - log_m[second]) / np.log(settings.view_distance_ratio),
            )
            stems, frames = stems + 1, frames + len(z)
            sums[0] += (z**2).sum(), len(z)
            for row, kept in ((1, apart < 1), (2, apart > 1.5)):
                product = (z[first] * z[second])[kept] / len(z)
                sums[row] += product.sum(), kept.sum() / len(z)
    total, same, distinct = sums[:, 0] / np.maximum(sums[:, 1], 1e-9)
    bias = max(distinct, _SMALLEST_SHARE)
    view = max(same - bias, _SMALLEST_SHARE)
    noise = max(total - bias - view, _SMALLEST_SHARE)
    return {
        "stems": stems,
        "frames": frames,
        "bias": _rounded(bias),
        "view": _rounded(view),
        "noise": _rounded(noise),
    }


def _standard_errors(
    drive: list[DriveFrame], quantity: str
) -> dict[int, list[tuple[float, float, float]]]:
    """Error over stated deviation, direction from the stem, and log distance, by labelled stem."""
    errors: dict[int, list[tuple[float, float, float]]] = defaultdict(list)
    for frame in drive:
        camera = np.array(frame.image["pose_world"]["origin_m"])
        for tree, index in frame.label_of.items():
            label, value = frame.labels[index], getattr(frame.measurements[tree], quantity)
            true = label.get(TRUTHS[quantity])
            if isinstance(value, Estimate) and true is not None:
                x, y = (camera - np.array(label["position_world_m"]))[:2]
                place = (math.atan2(y, x), math.log(max(math.hypot(x, y), 0.1)))
                doubt = TrackingSettings().border_doubt if _at_border(frame, tree) else 1.0
                errors[label["stem"]].append(((value.value - true) / value.std / doubt, *place))
    return errors


def _rounded(value: float) -> float:
    return round(float(value), 4)
