"""Stems followed in the picture, where there are no metres."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from basetree.arrays import Float, Index, UInt8
from basetree.matching import match_greedily
from edgetree.detections import TreeDetections
from edgetree.frames.followed import are_followed
from edgetree.frames.image_motion import similarity, small_grey
from edgetree.measure import Estimate, Failure

# Lengths are in widths of the picture. The constants were chosen on six simulated drives with seeds
# below 1000 (`benchmarks/counting.py`); halves and doubles of them change the counts by 5 %.

_CONFIRM_FRAMES: Final = 3
_MEMORY_S, _NEW_MEMORY_S = 2.0, 0.5
# Frames that a stem may be missing in, however far they are apart.
_MISSED_FRAMES: Final = 2
# Largest chi-square of a horizontal place, with one degree of freedom: three deviations. A place
# that is expected with a larger deviation than the other number tells nothing.
_GATE, _MOST_VAGUE = 9.0, 0.2
# Standard deviation of the middle of a box, as a share of its width, and at least.
_MIDDLE_SHARE, _MIDDLE_LEAST = 0.12, 0.003
_WIDTH_STD, _FOOT_STD = 0.35, 0.06
_MOST_LIKENESS_COST: Final = 9.0
# Deviations of the speed of a stem against the picture: at first, and as it changes, per s.
_SPEED_STD, _ACCELERATION_STD = 0.08, 0.15
# Deviation of the picture's own motion where it is not found, per s.
_TURN_STD: Final = 0.5
# As of `StemTracker`: added to the cost of a match, as chi-squares.
_NEW_COST, _UNSEEN_COST, _DOUBT_COST = 4.0, 4.0, 10.0
# Deviation of a count of N stems, as a share of the root of N: fitted on the six drives.
_COUNT_STD: Final = 0.7

_TRACK: Final = np.dtype(
    [
        ("number", np.intp),
        ("frames", np.intp),
        ("last_seen_s", np.float64),
        ("missed", np.intp),
        ("middle", np.float64, (2,)),
        ("covariance", np.float64, (2, 2)),
        ("log_width", np.float64),
        ("foot", np.float64),
    ]
)


class PictureTracker:
    """Follows stems from frame to frame by their boxes and the motion of the picture.

    The picture's own motion, which turns of the camera make, is found from its corners. Against it
    each stem moves on at a speed of its own. A detection is taken for the stem that is expected
    there, by a chi-square of the horizontal place; width and foot of the box decide between stems
    that are near each other. Stems hidden or out of the picture for longer than 2 s are new ones
    when they come back.

    Attributes:
        count: Number of different stems so far: those that three frames show.
        frames: Number of frames so far.
    """

    def __init__(self) -> None:
        self.count = self.frames = 0
        self._detections = self._followed = 0
        self._tracks = np.zeros(0, _TRACK)
        self._time_s: float | None = None
        self._grey: UInt8 | None = None

    def update(
        self, picture: UInt8 | None, trees: TreeDetections, time_s: float
    ) -> tuple[int | None, ...]:
        """Follow the stems into one more frame.

        Args:
            picture: (H, W, 3) uint8 BGR; None if there is none, for the motion of the picture.
            trees: The trees of the frame.
            time_s: Time stamp, s.

        Returns:
            The number of each tree's stem, from 1 on; None until enough frames show the stem.
        """
        step_s = 0.0 if self._time_s is None else max(time_s - self._time_s, 0.0)
        self._time_s = time_s
        self._move(picture, step_s)
        seen = _Seen(trees)
        number_of: list[int | None] = [None] * len(trees)
        rows, columns = self._match(seen)
        self._see(rows, seen, columns, time_s)
        self._add(seen, np.setdiff1d(np.arange(len(trees)), columns), time_s)
        for tree, number in zip(columns.tolist(), self._tracks["number"][rows], strict=True):
            number_of[tree] = int(number) or None
        self._forget(time_s)
        self.frames += 1
        self._detections += len(trees)
        self._followed += sum(number is not None for number in number_of)
        return tuple(number_of)

    def different(self) -> Estimate | Failure:
        """The number of different stems so far.

        Its error is that of simulated drives, where the truth is the number of stems that the model
        finds in three frames: what it never finds is not counted.
        """
        if not are_followed(self._followed, self._detections):
            return Failure(
                "stems could not be followed from frame to frame, as the frames are too few or too"
                " far apart in time"
            )
        return Estimate(float(self.count), _COUNT_STD * math.sqrt(max(self.count, 1)))

    def _move(self, picture: UInt8 | None, step_s: float) -> None:
        """Predict where the stems are in the new frame."""
        grey = None if picture is None else small_grey(picture)
        matrix = None if grey is None or self._grey is None else similarity(self._grey, grey)
        self._grey, tracks = grey, self._tracks
        if not len(tracks):
            return
        turn = np.array([[1.0, step_s], [0.0, 1.0]])
        tracks["middle"] = tracks["middle"] @ turn.T
        noise = _ACCELERATION_STD**2 * np.array(
            [[step_s**4 / 4, step_s**3 / 2], [step_s**3 / 2, step_s**2]]
        )
        tracks["covariance"] = turn @ tracks["covariance"] @ turn.T + noise
        if matrix is None:
            tracks["covariance"][:, 0, 0] += (_TURN_STD * step_s) ** 2
            return
        back = np.linalg.inv(matrix[:, :2])  # from the last frame to this one
        at = np.stack([tracks["middle"][:, 0], tracks["foot"]], 1) - matrix[:, 2]
        moved = at @ back.T
        scale = math.sqrt(abs(np.linalg.det(back)))
        tracks["middle"][:, 0], tracks["foot"] = moved[:, 0], moved[:, 1]
        tracks["log_width"] += math.log(scale)

    def _match(self, seen: _Seen) -> tuple[Index, Index]:
        tracks = self._tracks
        variance = tracks["covariance"][:, 0, 0][:, None] + seen.middle_std**2
        chi_square = (tracks["middle"][:, 0][:, None] - seen.middle) ** 2 / variance
        off = (tracks["log_width"][:, None] - seen.log_width) / _WIDTH_STD
        foot = (tracks["foot"][:, None] - seen.foot) / _FOOT_STD
        cost = chi_square + np.log(variance / seen.middle_std**2)
        cost += np.minimum(off**2, _MOST_LIKENESS_COST) + np.minimum(foot**2, _MOST_LIKENESS_COST)
        cost += np.where(tracks["number"] > 0, 0.0, _NEW_COST)[:, None]
        cost += np.where(tracks["missed"] > 0, _UNSEEN_COST, 0.0)[:, None]
        cost += _DOUBT_COST * (1 - seen.score)
        vague = tracks["covariance"][:, 0, 0] > _MOST_VAGUE**2
        return match_greedily(cost, (chi_square <= _GATE) & ~vague[:, None])

    def _see(self, rows: Index, seen: _Seen, columns: Index, time_s: float) -> None:
        """Correct the stems by the detections that they are."""
        tracks = self._tracks
        tracks["missed"] += 1
        covariance = tracks["covariance"][rows]
        gain = covariance[:, :, 0] / (covariance[:, 0, 0] + seen.middle_std[columns] ** 2)[:, None]
        off = seen.middle[columns] - tracks["middle"][rows, 0]
        tracks["middle"][rows] += gain * off[:, None]
        tracks["covariance"][rows] -= gain[:, :, None] * covariance[:, None, 0, :]
        for name, values in (("log_width", seen.log_width), ("foot", seen.foot)):
            tracks[name][rows] += (values[columns] - tracks[name][rows]) / 2
        tracks["frames"][rows] += 1
        tracks["missed"][rows] = 0
        tracks["last_seen_s"][rows] = time_s
        new = rows[(tracks["frames"][rows] >= _CONFIRM_FRAMES) & (tracks["number"][rows] == 0)]
        tracks["number"][new] = self.count + 1 + np.arange(len(new))
        self.count += len(new)

    def _add(self, seen: _Seen, columns: Index, time_s: float) -> None:
        more = np.zeros(len(columns), _TRACK)
        more["frames"] = 1
        more["last_seen_s"] = time_s
        more["middle"][:, 0] = seen.middle[columns]
        more["covariance"][:, 0, 0] = seen.middle_std[columns] ** 2
        more["covariance"][:, 1, 1] = _SPEED_STD**2
        more["log_width"], more["foot"] = seen.log_width[columns], seen.foot[columns]
        self._tracks = np.concatenate([self._tracks, more])

    def _forget(self, time_s: float) -> None:
        tracks = self._tracks
        memory_s = np.where(tracks["number"] > 0, _MEMORY_S, _NEW_MEMORY_S)
        self._tracks = tracks[
            (time_s - tracks["last_seen_s"] <= memory_s) | (tracks["missed"] <= _MISSED_FRAMES)
        ]


class _Seen:
    """Boxes of a frame, in widths of the picture."""

    def __init__(self, trees: TreeDetections) -> None:
        boxes = trees.boxes_px.astype(np.float64) / trees.image_width
        width = np.maximum(boxes[:, 2] - boxes[:, 0], 1e-4)
        self.middle: Float = (boxes[:, 0] + boxes[:, 2]) / 2
        self.middle_std: Float = np.maximum(_MIDDLE_SHARE * width, _MIDDLE_LEAST)
        self.log_width: Float = np.log(width)
        self.foot: Float = boxes[:, 3]
        self.score: Float = trees.scores.astype(np.float64)
