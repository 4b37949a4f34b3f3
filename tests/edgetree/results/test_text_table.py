"""The text table: values with ±, failures, warnings and evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from edgetree.measure import Estimate, Evidence, Failure, PixelSize, StemProfile, TreeMeasurement
from edgetree.results.text_table import table_lines
from edgetree.results.units import AMOUNTS, direction_words

MEASURED = TreeMeasurement(
    diameter_m=Estimate(0.3124, 0.0081),
    dbh_m=Failure("no ground in view"),
    cut_height_m=Failure("no ground in view"),
    inclination_deg=Estimate(4.1, 0.9),
    lean_direction_deg=Estimate(93.0, 10.0),
    distance_m=Estimate(5.257, 0.05),
    axis_distance_m=Estimate(4.81, 0.05),
    taper_cm_per_m=Estimate(1.23, 0.34),
    seen_volume_m3=Estimate(0.2041, 0.012),
    volume_m3=Failure("no species given"),
    profile=StemProfile(
        heights_from="ground",
        height_m=np.array([0.3, 0.4, 0.5]),
        diameter_m=np.array([0.32, 0.31, 0.3]),
        diameter_std_m=np.full(3, 0.01),
        edges_m=np.zeros((3, 2, 3)),
    ),
    cut_point_m=Failure("x"),
    cut_point_machine_m=Failure("x"),
    evidence=Evidence(
        method="mask + depth",
        arc_deg=92.4,
        valid_depth_share=0.83,
        visible_share=0.95,
        ground="no ground",
        warnings=("a warning",),
    ),
)


def test_a_tree_has_a_row_and_notes_below() -> None:
    header, row, *notes, last = table_lines([MEASURED], (3,))
    names = ["tree", "diameter", "DBH", "cut height", "lean", "distance"]
    assert [name for name in names if name not in header] == []
    cells = ["3", "31.2 ± 0.8 cm", "–", "–", "4.1 ± 0.9° right", "5.26 ± 0.05 m"]
    assert [cell.strip() for cell in row.split("  ") if cell.strip()] == cells
    assert [note.strip() for note in notes] == [
        "profile: 3 diameters from 0.3 to 0.5 m above the ground, taper 1.2 ± 0.3 cm/m, volume of"
        " this",
        "part 0.204 ± 0.012 m³",
        "no DBH, cut height: no ground in view",
        "warning: a warning",
        "from mask + depth; 95% of the stem visible, depth at 83% of it, an arc of 92° seen",
    ]
    assert "one standard deviation" in last


def test_the_volume_of_the_whole_stem_names_its_function() -> None:
    pine = replace(MEASURED, species="pine", volume_m3=Estimate(0.4567, 0.08))
    line = "      volume of the whole stem: 0.457 ± 0.080 m³ (pine, Laasasenaho 1982)"
    assert line in list(table_lines([pine], (1,)))


def test_a_missing_volume_is_told_only_if_a_species_was_given() -> None:
    assert "stem volume" not in "".join(table_lines([MEASURED], (1,)))
    pine = replace(MEASURED, species="pine", volume_m3=Failure("no ground in view"))
    lines = list(table_lines([pine], (1,)))
    assert "      no DBH, cut height, stem volume: no ground in view" in lines


def test_the_distance_to_the_axis_stands_in_for_that_to_the_cut() -> None:
    line = "      distance to the axis: 4.81 ± 0.05 m"
    assert line not in list(table_lines([MEASURED], (1,)))
    assert line in list(table_lines([replace(MEASURED, distance_m=Failure("no cut"))], (1,)))


def test_columns_are_aligned_with_their_names() -> None:
    header, row, *_ = table_lines([MEASURED], (12,))
    assert header.index("diameter") == row.index("31.2")
    assert header.index("lean") == row.index("4.1")
    assert header.index("distance") == row.index("5.26")


def test_the_ground_is_shown_unless_a_note_contains_it() -> None:
    told = replace(MEASURED, evidence=replace(MEASURED.evidence, ground="a plane of 80 points"))
    assert "      ground: a plane of 80 points" in list(table_lines([told], (1,)))


def test_a_reason_for_all_quantities_is_shown_once() -> None:
    lines = list(table_lines([TreeMeasurement.failed("no depth on the stem")], (1,)))
    assert lines[2].strip() == "not measured: no depth on the stem"
    assert len(lines) == 4


def test_the_width_in_the_picture_is_told_where_there_is_no_diameter() -> None:
    size = PixelSize(
        width_px=Estimate(83.0, 3.0),
        width_deg=None,
        width_at="breast height",
        lean_in_picture_deg=Estimate(1.0, 0.2),
    )
    assert "px wide" not in "".join(table_lines([MEASURED], (1,), [size]))
    failed = TreeMeasurement.failed("no depth on the stem")
    assert "83 ± 3 px wide" in "".join(table_lines([failed], (1,), [size]))


def test_long_reasons_are_wrapped() -> None:
    lines = list(table_lines([TreeMeasurement.failed("because of this " * 20)], (1,)))
    assert max(map(len, lines)) <= 100


@pytest.mark.parametrize("width", [40, 60, 80, 120])
def test_no_line_is_wider_than_the_terminal(width: int) -> None:
    leaning = replace(MEASURED, dbh_m=Estimate(0.3, 0.01), cut_height_m=Estimate(0.2, 0.01))
    lines = list(table_lines([leaning, MEASURED], (1, 12), width=width))
    assert max(map(len, lines)) <= width
    text = " ".join(" ".join(lines).split())
    for value in ("31.2 ± 0.8 cm", "30.0 ± 1.0 cm", "4.1 ± 0.9° right", "5.26 ± 0.05 m"):
        assert value in text  # in its column or in a line below, and not cut in two


def test_options_in_reasons_are_not_cut_in_two() -> None:
    failed = TreeMeasurement.failed(f"{'metres ' * 9}need --camera-height")
    assert "--camera-height" in "\n".join(table_lines([failed], (1,), width=80))


def test_an_empty_table_says_no_trees() -> None:
    assert list(table_lines([], ())) == ["no trees"]


@pytest.mark.parametrize(
    ("direction_deg", "words"),
    [
        (0.0, "away"),
        (88.0, "right"),
        (-88.0, "left"),
        (179.0, "towards"),
        (-179.0, "towards"),
        (40.0, "away, right"),
        (-140.0, "towards, left"),
    ],
)
def test_directions_are_words(direction_deg: float, words: str) -> None:
    assert direction_words(Estimate(5.0, 1.0), Estimate(direction_deg, 9.0)) == words


def test_an_upright_stem_has_no_direction() -> None:
    assert direction_words(Estimate(1.0, 1.0), Estimate(90.0, 9.0)) == ""
    assert direction_words(Estimate(5.0, 1.0), Failure("not known")) == ""


def test_no_standard_deviation_is_shown_as_zero() -> None:
    assert AMOUNTS["diameter_m"].with_std(Estimate(0.3, 0.0001)) == "30.0 ± 0.1 cm"
