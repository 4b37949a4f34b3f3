"""Matching stems by number and by position."""

from __future__ import annotations

import pytest

from basetree.errors import InputError
from edgetree.check import CaliperStem, CaliperTable, MeasuredStem, MeasuredTable, compare
from edgetree.check import match_stems as match
from edgetree.measure import Estimate, Failure

Xyz = tuple[float, float, float]

VALUES = {"diameter_m": Estimate(0.3, 0.01), "dbh_m": Failure("-"), "cut_height_m": Failure("-")}
READING = {"diameter_m": Estimate(0.31, 0.0)}


def measured(*stems: MeasuredStem) -> MeasuredTable:
    return MeasuredTable("trees.csv", stems)


def caliper(*stems: CaliperStem) -> CaliperTable:
    return CaliperTable("caliper.csv", stems)


def found(tree: int, camera: Xyz | None = None, machine: Xyz | None = None) -> MeasuredStem:
    return MeasuredStem("a", tree, VALUES, camera, machine)


def typed(line: int, x: float, y: float | None, z: float | None) -> CaliperStem:
    return CaliperStem(line, READING, point_m=(x, y, z))


def numbers(pairs: object) -> list[tuple[int, int]]:
    return [(pair.caliper.line, pair.measured.tree) for pair in pairs]  # type: ignore[attr-defined]


def test_frame_and_number_match() -> None:
    machine = measured(*(MeasuredStem(f, n, VALUES) for f in "ab" for n in (1, 2)))
    stems = (
        CaliperStem(2, READING, "b", 2),
        CaliperStem(3, READING, "a.jpg", 2),
        CaliperStem(4, READING, "a", 3),
        CaliperStem(5, READING, "c", 1),
    )
    result = match(machine, caliper(*stems), 0.5)
    assert result.by == "number"
    assert [(pair.caliper.line, pair.measured.name) for pair in result.pairs] == [
        (2, "b tree 2"),
        (3, "a tree 2"),
    ]
    assert [stem.name for stem in result.caliper_only] == ["line 4: a tree 3", "line 5: c tree 1"]
    assert [stem.name for stem in result.measured_only] == ["a tree 1", "b tree 1"]


def test_leading_zeros_that_a_spreadsheet_removed_are_found() -> None:
    machine = measured(*(MeasuredStem(frame, 1, VALUES) for frame in ("0012", "0112")))
    result = match(machine, caliper(CaliperStem(2, READING, "12", 1)), 0.5)
    assert [pair.measured.frame for pair in result.pairs] == ["0012"]
    two = measured(*(MeasuredStem(frame, 1, VALUES) for frame in ("0012", "012")))
    with pytest.raises(InputError, match=r"none of its stems \(1\)"):
        match(two, caliper(CaliperStem(2, READING, "12", 1)), 0.5)


def test_the_only_frame_need_not_be_typed() -> None:
    result = match(measured(found(1), found(2)), caliper(CaliperStem(2, READING, None, 2)), 0.5)
    assert numbers(result.pairs) == [(2, 2)]


def test_several_frames_need_a_name() -> None:
    machine = measured(MeasuredStem("a", 1, VALUES), MeasuredStem("b", 1, VALUES))
    with pytest.raises(InputError, match=r"caliper\.csv, line 7: no frame, but trees\.csv has 2"):
        match(machine, caliper(CaliperStem(7, READING, None, 1)), 0.5)


def test_a_stem_that_occurs_twice_is_named() -> None:
    one, again = CaliperStem(2, READING, "a", 1), CaliperStem(3, READING, "a.png", 1)
    with pytest.raises(InputError, match=r"caliper\.csv: a tree 1 occurs 2 times"):
        match(measured(found(1)), caliper(one, again), 0.5)
    with pytest.raises(InputError, match=r"trees\.csv: a tree 1 occurs 2 times"):
        match(measured(found(1), found(1)), caliper(one), 0.5)


def test_nothing_matched_is_an_error() -> None:
    with pytest.raises(InputError, match=r"none of its stems \(1\) is in .*: expected its frames"):
        match(measured(found(1)), caliper(CaliperStem(2, READING, "a", 9)), 0.5)
    with pytest.raises(InputError, match=r"expected positions within 0\.5 m"):
        match(measured(found(1, (0, 0, 5))), caliper(typed(2, 3, 0, 5)), 0.5)
    with pytest.raises(InputError, match=r"trees\.csv has no positions"):
        match(measured(found(1)), caliper(typed(2, 3, 0, 5)), 0.5)


def test_the_nearest_pair_is_matched_first_and_once() -> None:
    machine = measured(found(1, (0, 0, 4)), found(2, (1.0, 0, 4)), found(3, (5, 0, 4)))
    hand = caliper(typed(2, 0.15, 0.0, 4), typed(3, 1.2, 0.1, 4), typed(4, 5.0, 0, 4.6))
    result = match(machine, hand, 0.5)
    assert result.by == "camera position"
    assert numbers(result.pairs) == [(2, 1), (3, 2)]
    assert [stem.line for stem in result.caliper_only] == [4]
    assert [stem.tree for stem in result.measured_only] == [3]
    wider = match(machine, hand, 0.7)
    assert numbers(wider.pairs) == [(2, 1), (3, 2), (4, 3)]


def test_the_nearest_stem_is_taken_and_not_the_first() -> None:
    machine = measured(found(1, (0, 0, 4)), found(2, (1, 0, 4)))
    assert numbers(match(machine, caliper(typed(2, 0.95, 0, 4)), 1.0).pairs) == [(2, 2)]


def test_the_pair_at_the_limit_counts() -> None:
    assert match(measured(found(1, (0, 0, 4))), caliper(typed(2, 0, 0, 4.5)), 0.5).pairs
    with pytest.raises(InputError):
        match(measured(found(1, (0, 0, 4))), caliper(typed(2, 0, 0, 4.51)), 0.5)


def test_pairs_with_a_rival_about_as_near_are_left_out() -> None:
    machine = measured(found(1, (0, 0, 4)), found(2, (0.3, 0, 4)), found(3, (9, 0, 4)))
    result = match(machine, caliper(typed(2, 0.12, 0, 4), typed(3, 9, 0, 4.1)), 0.5)
    assert numbers(result.ambiguous) == [(2, 1)]
    assert numbers(result.pairs) == [(3, 3)]
    assert [stem.tree for stem in result.measured_only] == [2]
    clear = match(machine, caliper(typed(2, 0.05, 0, 4), typed(3, 9, 0, 4.1)), 0.5)
    assert numbers(clear.pairs) == [(2, 1), (3, 3)]
    rivals = match(
        measured(found(1, (0, 0, 4))), caliper(typed(2, 0.2, 0, 4), typed(3, -0.3, 0, 4)), 1
    )
    assert numbers(rivals.ambiguous) == [(2, 1)]
    with pytest.raises(InputError, match=r"ambiguous, the first: line 2: expected tree numbers"):
        compare(measured(found(1, (0, 0, 4)), found(2, (0.3, 0, 4))), caliper(typed(2, 0.1, 0, 4)))


def test_the_machines_frame_is_used_where_it_is_known() -> None:
    machine = measured(found(1, (9, 9, 9), (4, 1, 0.3)), found(2, (4, 1, 0.3), (8, 1, 0.3)))
    result = match(machine, caliper(typed(2, 4.1, 1, 0.3)), 0.5)
    assert result.by == "machine position"
    assert numbers(result.pairs) == [(2, 1)]


def test_the_vertical_coordinate_may_be_left_out() -> None:
    machine = measured(found(1, None, (4, 1, 0.9)))
    assert match(machine, caliper(typed(2, 4, 1, None)), 0.5).pairs
    with pytest.raises(InputError, match=r"line 2: the column y_m is missing"):
        match(machine, caliper(typed(2, 4, None, 0.9)), 0.5)
    camera = measured(found(1, (4, 1, 9)))
    assert match(camera, caliper(typed(2, 4, None, 9)), 0.5).pairs
    with pytest.raises(InputError, match=r"line 2: the column z_m is missing"):
        match(camera, caliper(typed(2, 4, 1, None)), 0.5)


def test_stems_of_other_frames_are_not_matched_by_position() -> None:
    machine = measured(MeasuredStem("a", 1, VALUES, (0, 0, 4)), MeasuredStem("b", 1, VALUES))
    stem = CaliperStem(2, READING, "b", None, (0, 0, 4))
    with pytest.raises(InputError, match=r"none of its stems \(1\)"):
        match(machine, caliper(stem), 0.5)
