"""Find the measured stem for each stem of the caliper's table, by number or by position."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeAlias

import numpy as np

from basetree.arrays import Float64
from basetree.counts import counted
from basetree.errors import InputError
from basetree.matching import match_greedily
from edgetree.check.stems import CaliperStem, CaliperTable, MeasuredStem, MeasuredTable

MatchedBy: TypeAlias = Literal["number", "machine position", "camera position"]

# A match is ambiguous if another stem is within the limit and less than this many times as far.
_CLEARLY_FARTHER: Final = 2.0
_MOST_DISTANCES: Final = 20_000_000
_MOST_NEAR: Final = 1_000_000
# The vertical axis of each frame, which the caliper's table may leave out.
_VERTICAL: Final = {"machine position": 2, "camera position": 1}


class Pair(NamedTuple):
    """A measured stem and the same stem in the caliper's table."""

    measured: MeasuredStem
    caliper: CaliperStem


@dataclass(frozen=True)
class Matching:
    """Which stems of two tables are the same.

    Attributes:
        by: What they were matched by.
        pairs: The matched stems, in the order of the caliper's table.
        ambiguous: Pairs matched by position for which another stem is about as near. They are not
            compared.
        caliper_only: Stems without a measured stem.
        measured_only: Measured stems without a reading of the caliper.
    """

    by: MatchedBy
    pairs: tuple[Pair, ...]
    ambiguous: tuple[Pair, ...]
    caliper_only: tuple[CaliperStem, ...]
    measured_only: tuple[MeasuredStem, ...]


def match_stems(measured: MeasuredTable, caliper: CaliperTable, max_distance_m: float) -> Matching:
    """Match the stems of two tables, one to one.

    Stems with numbers are matched by frame and number. Otherwise all pairs of a frame that are
    within `max_distance_m` are sorted by distance, and the nearest pair of which both stems are
    still free is matched first (greedy assignment).

    Args:
        measured: The machine's table.
        caliper: The caliper's table.
        max_distance_m: Largest distance between the positions of a pair, in metres.

    Raises:
        InputError: a stem occurs twice, the frame or the position is missing, or no stem matches.
    """
    _check_unique(measured.source, (stem.name for stem in measured.stems))
    frames = _frames_of(measured, caliper)
    by: MatchedBy = "number"
    ambiguous: list[Pair] = []
    if any(stem.tree is not None for stem in caliper.stems):
        pairs = _by_number(measured, caliper, frames)
    else:
        by, points = _measured_points(measured)
        pairs, ambiguous = _by_position(caliper, frames, points, _VERTICAL[by], max_distance_m)
    if not pairs and not ambiguous:
        raise InputError(
            f"{caliper.source}: none of its stems ({len(caliper.stems)}) is in {measured.source}:"
            " expected "
            + (
                "its frames and tree numbers"
                if by == "number"
                else f"positions within {max_distance_m:g} m of those there"
            )
        )
    known = {id(stem) for pair in (*pairs, *ambiguous) for stem in pair}
    return Matching(
        by=by,
        pairs=tuple(pairs),
        ambiguous=tuple(ambiguous),
        caliper_only=tuple(stem for stem in caliper.stems if id(stem) not in known),
        measured_only=tuple(stem for stem in measured.stems if id(stem) not in known),
    )


def _check_unique(source: str, names: Iterable[str]) -> None:
    for name, count in Counter(names).items():
        if count > 1:
            raise InputError(
                f"{source}: {name} occurs {counted(count, 'time')}: expected each stem once"
            )


def _frames_of(measured: MeasuredTable, caliper: CaliperTable) -> dict[int, str]:
    """The measured table's frame of each stem of the caliper's table, by the stem's `id`.

    A frame may be typed with the suffix of its file, and without leading zeros, which spreadsheets
    remove.
    """
    known = {stem.frame for stem in measured.stems}
    without_zeros = {name.lstrip("0"): name for name in known}
    if len(without_zeros) < len(known):
        without_zeros = {}
    frames = {}
    for stem in caliper.stems:
        if stem.frame is None and len(known) > 1:
            raise InputError(
                f"{caliper.source}, line {stem.line}: no frame, but {measured.source} has"
                f" {len(known)}: expected the column frame with one of their names"
            )
        name = next(iter(known)) if stem.frame is None else stem.frame
        if name not in known:
            name = Path(name).stem
        frames[id(stem)] = name if name in known else without_zeros.get(name.lstrip("0"), name)
    return frames


def _by_number(
    measured: MeasuredTable, caliper: CaliperTable, frames: dict[int, str]
) -> list[Pair]:
    keys = [(frames[id(stem)], stem.tree) for stem in caliper.stems]
    _check_unique(caliper.source, (f"{frame} tree {tree}" for frame, tree in keys))
    stems = {(stem.frame, stem.tree): stem for stem in measured.stems}
    return [
        Pair(stems[frame, tree], stem)
        for (frame, tree), stem in zip(keys, caliper.stems, strict=True)
        if tree is not None and (frame, tree) in stems
    ]


_Placed: TypeAlias = tuple[MeasuredStem, tuple[float, float, float]]


def _measured_points(measured: MeasuredTable) -> tuple[MatchedBy, list[_Placed]]:
    """The stems with positions: in the machine's frame if there are any, or in the camera's."""
    stems = measured.stems
    machine = [(stem, stem.point_machine_m) for stem in stems if stem.point_machine_m is not None]
    if machine:
        return "machine position", machine
    camera = [(stem, stem.point_camera_m) for stem in stems if stem.point_camera_m is not None]
    if camera:
        return "camera position", camera
    raise InputError(
        f"{measured.source} has no positions: expected cut points there, or the column tree in the"
        " caliper's table"
    )


def _by_position(
    caliper: CaliperTable,
    frames: dict[int, str],
    placed: list[_Placed],
    vertical: int,
    max_distance_m: float,
) -> tuple[list[Pair], list[Pair]]:
    """The clear and the ambiguous pairs, in the order of the caliper's table."""
    if len(caliper.stems) * len(placed) > _MOST_DISTANCES:
        raise InputError(
            f"{caliper.source}: {len(caliper.stems)} positions for {len(placed)} measured stems:"
            " expected fewer, or the column tree"
        )
    places: dict[str, list[int]] = {}
    for column, (found, _) in enumerate(placed):
        places.setdefault(found.frame, []).append(column)
    points_m = np.array([point_m for _, point_m in placed])
    distance_m = np.full((len(caliper.stems), len(placed)), np.inf)
    for row, stem in enumerate(caliper.stems):
        columns = places.get(frames[id(stem)], [])
        distance_m[row, columns] = _distances_m(caliper.source, stem, points_m[columns], vertical)
    distance_m[distance_m > max_distance_m] = np.inf
    near = np.isfinite(distance_m)
    if np.count_nonzero(near) > _MOST_NEAR:
        raise InputError(
            f"{caliper.source}: more than {_MOST_NEAR} pairs of stems are within"
            f" {max_distance_m:g} m: expected a smaller --max-distance"
        )
    clear: list[Pair] = []
    ambiguous: list[Pair] = []
    for row, column in zip(*match_greedily(distance_m, near), strict=True):
        others = (np.delete(distance_m[row], column), np.delete(distance_m[:, column], row))
        nearest = min(each.min(initial=np.inf) for each in others)
        doubtful = nearest < _CLEARLY_FARTHER * distance_m[row, column]
        pair = Pair(placed[column][0], caliper.stems[row])
        (ambiguous if doubtful else clear).append(pair)
    return clear, ambiguous


def _distances_m(source: str, stem: CaliperStem, points_m: Float64, vertical: int) -> Float64:
    """(N,) distances of a stem from (N, 3) points; horizontal without its vertical coordinate."""
    known = [axis for axis, typed_m in enumerate(stem.point_m) if typed_m is not None]
    for axis in range(3):
        if axis not in known and axis != vertical:
            raise InputError(
                f"{source}, line {stem.line}: the column {'xyz'[axis]}_m is missing: expected x_m,"
                f" y_m and z_m; only the vertical one, {'xyz'[vertical]}_m, may be left out"
            )
    typed_m = np.array([stem.point_m[axis] for axis in known], np.float64)
    return np.asarray(np.linalg.norm(points_m[:, known] - typed_m, axis=1))
