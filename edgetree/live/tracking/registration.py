"""The camera's motion from the stems that it sees: registration of points on the level plane."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.live.tracking.motion import CameraMotion
from edgetree.live.tracking.plane import chi_squares, place_jacobian, turns, wrapped

_ROUNDS = 2
# Residuals beyond this many standard deviations count less (Huber).
_HUBER_STDS = 2.0
# Two pairs of stems that are closer than this tell no heading.
_MIN_BASELINE_M = 0.7
# Pairs of pairs that are tried, those that agree best with the prediction first.
_MAX_TRIALS = 240
# Distances between stems may differ by this many standard deviations.
_MAX_STDS = 3.0
# Without a prediction, so many stems must agree. A second place that agrees nearly as well makes
# both doubtful.
_MIN_LOST_INLIERS, _SECOND_BEST = 4, 0.8
_OTHER_PLACE_M, _OTHER_HEADING_RAD = 0.5, 0.1


def refine_place(
    predicted: tuple[Float, Float],
    start: Float,
    followed: Float,
    seen: Float,
    covariances: tuple[Float, Float],
) -> tuple[Float, Float]:
    """Place, heading and speed from the prediction and K matched stems.

    Weighted least squares on the level plane by Gauss and Newton, with Huber's weights; the
    prediction counts with its covariance.

    Args:
        predicted: (6,) state and (6, 6) covariance as in `CameraMotion`.
        start: (6,) state to start from.
        followed: (K, 2) places of the stems in the map.
        seen: (K, 2) the same stems in the level frame.
        covariances: (K, 2, 2) of both.

    Returns:
        State and covariance.
    """
    prior = np.linalg.inv(predicted[1])
    state = start.copy()
    for _ in range(_ROUNDS):
        turn = turns(state[2])
        # 1. What is left between the stems, and its covariance; large rests weigh less.
        turned = seen @ turn.T
        offset = followed - turned - state[:2]
        covariance = covariances[0] + turn @ covariances[1] @ turn.T
        apart = np.sqrt(chi_squares(offset, covariance))
        weight = _HUBER_STDS / np.maximum(apart, _HUBER_STDS)
        # 2. One step of the normal equations, to which the prediction adds its information.
        jacobian = place_jacobian(turned)
        weighted = jacobian.transpose(0, 2, 1) @ np.linalg.inv(covariance) * weight[:, None, None]
        information = prior.copy()
        information[:3, :3] += (weighted @ jacobian).sum(0)
        gradient = prior @ (predicted[0] - state)
        gradient[:3] += (weighted @ offset[..., None]).sum((0, 2))
        state = state + np.linalg.solve(information, gradient)
    return state, np.linalg.inv(information)


def find_place(
    motion: CameraMotion,
    followed: Float,
    followed_std_m: Float,
    seen: Float,
    seen_std_m: Float,
    alike: Bool,
    *,
    lost: bool,
) -> Float | None:
    """Search for the place from which the stems look as they do, without matches.

    Every two followed stems and two seen ones that are as far apart as these give a place and a
    heading. The one wins from which most seen stems meet a followed one, and which the prediction
    makes likely.

    Args:
        motion: The prediction.
        followed: (T, 2) places of the stems in the map.
        followed_std_m: (T,) their standard deviations.
        seen: (M, 2) stems in the level frame.
        seen_std_m: (M,) their standard deviations.
        alike: (T, M) pairs whose diameters may be the same.
        lost: Whether the prediction is worthless.

    Returns:
        (3,) x m, y m and heading rad of the camera; None if no place is clearly the best.
    """
    rows, columns = np.nonzero(alike & _within_reach(motion, followed, seen, lost))
    trials = _trials(followed, followed_std_m, seen, seen_std_m, rows, columns)
    if not len(trials):
        return None
    # 1. The place and the heading that each pair of pairs gives.
    first, second = trials.T
    map_way = followed[rows[second]] - followed[rows[first]]
    level_way = seen[columns[second]] - seen[columns[first]]
    heading = np.arctan2(map_way[:, 1], map_way[:, 0]) - np.arctan2(
        level_way[:, 1], level_way[:, 0]
    )
    turn = turns(heading)
    map_middle = (followed[rows[first]] + followed[rows[second]]) / 2
    level_middle = (seen[columns[first]] + seen[columns[second]]) / 2
    place = map_middle - (turn @ level_middle[..., None])[..., 0]
    # 2. How far each is from the prediction; the least surprising ones are kept.
    off = np.column_stack([place, heading]) - motion.state[:3]
    off[:, 2] = wrapped(off[:, 2])
    surprise = np.zeros(len(off))
    if not lost:
        surprise = ((off @ np.linalg.inv(motion.covariance[:3, :3])) * off).sum(1)
        best = np.argsort(surprise, kind="stable")[:_MAX_TRIALS]
        place, turn, off, surprise = place[best], turn[best], off[best], surprise[best]
    # 3. Each seen stem scores by how near its followed stem is, up to `_MAX_STDS`.
    at = seen @ turn.transpose(0, 2, 1) + place[:, None]
    gap = np.linalg.norm(at[:, None] - followed[:, None], axis=-1)
    std_m = np.hypot(followed_std_m[:, None], seen_std_m)
    apart = np.where(alike, gap / std_m, np.inf).min(1)
    gain = np.maximum(_MAX_STDS**2 - apart**2, 0.0).sum(1)
    score = gain - surprise
    # 4. The best one counts if enough stems meet, and no other place scores nearly as well.
    winner = int(score.argmax())
    elsewhere = np.hypot(off[:, 0] - off[winner, 0], off[:, 1] - off[winner, 1]) > _OTHER_PLACE_M
    elsewhere |= np.abs(off[:, 2] - off[winner, 2]) > _OTHER_HEADING_RAD
    if (apart[winner] < _MAX_STDS).sum() < (_MIN_LOST_INLIERS if lost else 2):
        return None
    if (score[elsewhere] > _SECOND_BEST * score[winner]).any():
        return None
    return np.asarray(motion.state[:3] + off[winner])


def _within_reach(motion: CameraMotion, followed: Float, seen: Float, lost: bool) -> Bool:
    """(T, M) pairs that the prediction allows."""
    if lost:
        return np.ones((len(followed), len(seen)), np.bool_)
    at = seen @ motion.rotation().T + motion.state[:2]
    reach_m = _MAX_STDS * np.sqrt(
        motion.covariance[0, 0]
        + motion.covariance[1, 1]
        + motion.covariance[2, 2] * (seen**2).sum(1)
    )
    gap = np.linalg.norm(followed[:, None] - at, axis=-1)
    return np.asarray(gap < reach_m + 1.0)


def _trials(
    followed: Float,
    followed_std_m: Float,
    seen: Float,
    seen_std_m: Float,
    rows: Index,
    columns: Index,
) -> Index:
    """(H, 2) pairs of candidates whose stems are equally far apart in the map and in the frame."""
    first, second = np.triu_indices(len(rows), 1)
    different = (rows[first] != rows[second]) & (columns[first] != columns[second])
    first, second = first[different], second[different]
    map_m = np.linalg.norm(followed[rows[first]] - followed[rows[second]], axis=1)
    level_m = np.linalg.norm(seen[columns[first]] - seen[columns[second]], axis=1)
    std_m = np.hypot(
        np.hypot(followed_std_m[rows[first]], followed_std_m[rows[second]]),
        np.hypot(seen_std_m[columns[first]], seen_std_m[columns[second]]),
    )
    fits = (np.abs(map_m - level_m) < _MAX_STDS * std_m) & (level_m > _MIN_BASELINE_M)
    pairs = np.stack([first[fits], second[fits]], -1)
    # The longest tell the heading best.
    return np.asarray(pairs[np.argsort(-level_m[fits], kind="stable")][: 8 * _MAX_TRIALS])
