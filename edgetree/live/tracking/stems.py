"""The map of followed stems."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float, Index
from edgetree.live.tracking.fusion import FUSED, add_views
from edgetree.live.tracking.motion import CameraMotion
from edgetree.live.tracking.settings import TrackingSettings
from edgetree.live.tracking.sightings import CUT_LEVEL, DIAMETER, QUANTITIES, Sightings
from edgetree.measure import Failure, TreeMeasurement

# A stem that is not confirmed is kept for at least this many frames without it.
_MISSED_FRAMES = 3

_STEM = np.dtype(
    [
        *FUSED.descr,
        ("number", np.intp),
        ("tree", np.intp),
        ("frames", np.intp),
        ("missed", np.intp),
        ("contradicting", np.intp),
        ("in_a_row", np.intp),
        ("split_from", np.intp),
        ("reference_m", np.float64),
        ("last_seen_s", np.float64),
    ]
)


class StemMap:
    """The stems that are followed, and when they are forgotten.

    Attributes:
        rows: (T,) what is known of each stem: `FUSED`, and its number, its tree in the latest frame
            (-1: none), frames that measured it, frames since it was last seen, frames that
            contradict its place (all, and in a row), the stem that it was split from (0: none), the
            height at which its line is kept, and when it was last seen.
        reasons: Why quantities could not be measured when the stem was last seen, for each stem.
        absorbed: Numbers of confirmed stems that turned out to be another one, by its number.
        map_part: Number of the map, from 1 on.
    """

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self._next_number = 1
        self.rows = np.zeros(0, _STEM)
        self.reasons: list[dict[str, Failure]] = []
        self.absorbed: dict[int, tuple[int, ...]] = {}
        self.map_part = 1

    def __len__(self) -> int:
        return len(self.rows)

    @property
    def confirmed(self) -> Bool:
        """(T,) whether enough frames agree."""
        return np.asarray(self.rows["frames"] >= self._settings.confirm_frames)

    def clear(self) -> None:
        """Forget all stems, and begin another map. Numbers go on."""
        self.map_part += 1
        self._keep(np.zeros(len(self), np.bool_))

    def number_from(self, first: int) -> None:
        """Give new stems numbers from here on, at least."""
        self._next_number = max(self._next_number, first)

    def forget(self, time_s: float) -> None:
        """Forget the stems that were not seen for too long."""
        away_s = time_s - self.rows["last_seen_s"]
        new = ~self.confirmed
        old = away_s > np.where(new, self._settings.new_memory_s, self._settings.memory_s)
        gone = old & (~new | (self.rows["missed"] >= _MISSED_FRAMES))
        if gone.any():
            self._keep(~gone)

    def _keep(self, kept: Bool) -> None:
        self.rows = self.rows[kept]
        numbers = set(self.rows["number"].tolist())
        self.absorbed = {key: each for key, each in self.absorbed.items() if key in numbers}
        self.reasons = [
            reason for reason, keep in zip(self.reasons, kept.tolist(), strict=True) if keep
        ]

    def begin_frame(self) -> None:
        """No stem is seen yet in a new frame."""
        self.rows["tree"] = -1
        self.rows["missed"] += 1

    def add(self, seen: Sightings, from_m: Float, time_s: float, split_from: int = 0) -> None:
        """Begin to follow stems, from sightings in the map."""
        count = len(seen)
        if not count:
            return
        more = np.zeros(count, _STEM)
        more["number"] = self._next_number + np.arange(count)
        more["stds"] = more["next_stds"] = np.inf
        more["conflict"] = 1.0
        more["reference_m"] = seen.point_m[:, 2]
        more["split_from"] = split_from
        self._next_number += count
        rows = len(self) + np.arange(count)
        self.rows = np.concatenate([self.rows, more])
        self.reasons += [{} for _ in range(count)]
        self.see(rows, seen, from_m, time_s)

    def see(self, rows: Index, seen: Sightings, from_m: Float, time_s: float) -> None:
        """Fuse sightings in the map with the stems that they are of."""
        if not len(rows):
            return
        at = seen.at_height(self.rows["reference_m"][rows])
        add_views(self.rows, rows, at, from_m, self._settings)
        self.rows["frames"][rows] += 1
        self.rows["in_a_row"][rows] = 0
        self.name(rows, seen.tree, time_s)

    def contradict(self, rows: Index, seen: Sightings, time_s: float) -> None:
        """Note sightings that are probably of these stems but elsewhere, without fusing them."""
        self.rows["contradicting"][rows] += 1
        self.rows["in_a_row"][rows] += 1
        self.name(rows, seen.tree, time_s)

    def name(self, rows: Index, trees: Index, time_s: float) -> None:
        """Note which trees of the frame the stems are."""
        self.rows["tree"][rows] = trees
        self.rows["missed"][rows] = 0
        self.rows["last_seen_s"][rows] = time_s

    def split(self, row: int, seen: Sightings, from_m: Float, time_s: float) -> None:
        """Begin a stem of its own from a sighting that contradicts another one."""
        self.rows["tree"][row] = -1
        self.rows["in_a_row"][row] = 0
        self.add(seen, from_m, time_s, split_from=int(self.rows["number"][row]))

    def at_height(self, rows: Index, height_m: Float) -> tuple[Float, Float]:
        """(K, 2) places of the axes of K stems at given heights, with (K, 2, 2) covariances."""
        line, covariance = self.rows["line"][rows], self.rows["line_covariance"][rows]
        rise = (height_m - self.rows["reference_m"][rows])[:, None]
        shift = np.zeros((len(rows), 2, 4))
        shift[:, 0, 0] = shift[:, 1, 1] = 1.0
        shift[:, 0, 2] = shift[:, 1, 3] = rise[:, 0]
        return line[:, :2] + rise * line[:, 2:], shift @ covariance @ shift.transpose(0, 2, 1)

    def level_camera(self, rows: Index, seen: Sightings, motion: CameraMotion) -> None:
        """Correct the camera's height by the cuts of K stems and their sightings."""
        known = np.isfinite(self.rows["stds"][rows, CUT_LEVEL] + seen.stds[:, CUT_LEVEL])
        rows, seen = rows[known], seen.select(np.flatnonzero(known))
        level_m = seen.values[:, CUT_LEVEL] + motion.height_m
        offset_m = self.rows["values"][rows, CUT_LEVEL] - level_m
        variance = self.rows["stds"][rows, CUT_LEVEL] ** 2 + seen.stds[:, CUT_LEVEL] ** 2
        motion.correct_height(offset_m, variance)

    def places_at(self, seen: Sightings) -> Float:
        """(T, M, 2) places of the axes of all stems at the heights of sightings."""
        return self._axes_at(seen.point_m[:, 2])

    def _axes_at(self, height_m: Float) -> Float:
        """(T, M, 2) places of the axes of all stems at M heights."""
        rise = (height_m - self.rows["reference_m"][:, None])[..., None]
        at = self.rows["line"][:, None, :2] + rise * self.rows["line"][:, None, 2:]
        return np.asarray(at)

    def overlap(self, seen: Sightings) -> Bool:
        """(M,) whether a stem of this frame stands where the sighting is.

        Stems do not overlap, so that such a sighting is a second detection of the same stem.
        """
        diameter_m = (self.rows["values"][:, None, DIAMETER] + seen.values[:, DIAMETER]) / 2
        here = (self.rows["tree"] >= 0)[:, None]
        gap_m = np.linalg.norm(self.places_at(seen) - seen.line[:, :2], axis=-1)
        return np.asarray((here & (gap_m < diameter_m)).any(0))

    def merge(self) -> None:
        """Keep only one of two stems that stand within each other, as real ones cannot.

        The one with more frames is kept, with the lower number if the other one is confirmed.
        """
        rows = self.rows
        seen = np.flatnonzero(rows["tree"] >= 0)
        at = self._axes_at(rows["reference_m"][seen])
        gap_m = np.linalg.norm(at - rows["line"][seen, :2], axis=-1)
        diameter_m = rows["values"][:, DIAMETER]
        within = gap_m < (diameter_m[:, None] + diameter_m[seen]) / 4
        within[seen, np.arange(len(seen))] = False
        if not within.any():
            return
        kept = np.ones(len(rows), np.bool_)
        for first, column in np.argwhere(within).tolist():
            pair = (first, int(seen[column]))
            if kept[list(pair)].all():
                weak, strong = sorted(pair, key=lambda row: int(rows["frames"][row]))
                if rows["frames"][weak] >= self._settings.confirm_frames:
                    first_number, last_number = sorted(rows["number"][list(pair)].tolist())
                    both = (self.absorbed.pop(key, ()) for key in (first_number, last_number))
                    self.absorbed[first_number] = (*sum(both, ()), last_number)
                    rows["number"][strong] = first_number
                if rows["tree"][strong] < 0:
                    rows["tree"][strong] = rows["tree"][weak]
                    rows["missed"][strong], rows["last_seen_s"][strong] = (
                        0,
                        rows["last_seen_s"][weak],
                    )
                kept[weak] = False
        self._keep(kept)

    def note_reasons(self, measurements: list[TreeMeasurement]) -> None:
        """Keep the reasons of what could not be measured in this frame."""
        for row in np.flatnonzero(self.rows["tree"] >= 0).tolist():
            measurement = measurements[self.rows["tree"][row]]
            for name in QUANTITIES:
                result = getattr(measurement, name)
                if isinstance(result, Failure):
                    self.reasons[row][name] = result
