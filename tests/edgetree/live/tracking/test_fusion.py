"""Fused values: intervals that hold, views that count, contradictions that are told."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from simulated_stand import DIAMETER_STD_M, Forest, without_diameter

from basetree.errors import InputError
from edgetree.live.tracking import ErrorShares, StemTracker, TrackingSettings
from edgetree.measure import Estimate, Failure, PointEstimate

SHARES = (0.3, 0.4, 0.3)
QUANTITIES = ("diameter", "dbh", "cut_height", "inclination", "position")
SETTINGS = TrackingSettings(**dict.fromkeys(QUANTITIES, ErrorShares(*SHARES)))


def drive_past(forest, tracker, frames, step_m=0.08):
    """Tracks after frames of a drive past stems at the left, at (x, 5)."""
    for index in range(frames):
        tracks = tracker.update(
            *forest.observe(index / 10, (step_m * (index - frames / 2), 0.0), 90.0)
        )
    return tracks


@pytest.mark.parametrize(("frames", "step_m"), [(5, 0.08), (20, 0.08), (100, 0.03), (100, 0.0)])
def test_intervals_hold_however_many_frames(frames, step_m):
    places = np.array(
        [[x, y] for y in (5.0, 7.0, 9.0) for x in np.arange(0.9 - 0.8 * y, 0.8 * y, 1.7)]
    )
    held = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        forest = Forest(places, rng.uniform(0.2, 0.5, len(places)), rng, SHARES)
        for track in drive_past(forest, StemTracker(SETTINGS), frames, step_m):
            off_m = np.linalg.norm(places - track.position_m.xyz_m[:2], axis=1)
            if track.frames >= 0.7 * frames:
                low, high = track.diameter_m.interval95
                held.append(low <= forest.diameters_m[off_m.argmin()] <= high)
    assert len(held) > 80
    assert 0.9 <= np.mean(held) <= 0.99


def test_bias_does_not_average_away(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng, SHARES)
    (few,) = drive_past(forest, StemTracker(SETTINGS), 10)
    (many,) = drive_past(forest, StemTracker(SETTINGS), 100)
    bias_m = math.sqrt(SHARES[0]) * DIAMETER_STD_M
    assert bias_m < many.diameter_m.std < few.diameter_m.std < DIAMETER_STD_M
    noise = TrackingSettings(diameter=ErrorShares(0.0, 0.0, 1.0))
    (wrong,) = drive_past(forest, StemTracker(noise), 100)
    assert wrong.diameter_m.std == pytest.approx(DIAMETER_STD_M / 10, rel=0.1)


def test_distinct_views_count_and_not_frames(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng, SHARES)
    (still,) = drive_past(forest, StemTracker(SETTINGS), 100, step_m=0.0)
    (moving,) = drive_past(forest, StemTracker(SETTINGS), 100)
    assert (still.frames, still.views, still.arc_deg) == (100, 1, 0.0)
    assert moving.frames == 100
    assert 5 <= moving.views <= 10
    assert moving.arc_deg == pytest.approx(2 * math.degrees(math.atan2(4.0, 5.0)), abs=12)
    assert moving.diameter_m.std < still.diameter_m.std
    assert still.diameter_m.std == pytest.approx(math.sqrt(0.3 + 0.4) * DIAMETER_STD_M, rel=0.02)


def test_says_when_more_views_do_not_help(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng, SHARES)
    (early,) = drive_past(forest, StemTracker(SETTINGS), 3)
    (late,) = drive_past(forest, StemTracker(SETTINGS), 100)
    assert early.more_views_help
    assert not late.more_views_help


def test_contradicting_diameters_widen_the_interval_and_warn(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng, SHARES)
    (agreed,) = drive_past(forest, StemTracker(SETTINGS), 100)
    assert agreed.warnings == ()
    tracker = StemTracker(SETTINGS)
    for index in range(100):
        frame, trees, (measured,) = forest.observe(index / 10, (0.08 * (index - 50), 0.0), 90.0)
        shifted = measured.diameter_m.value + 0.15 * (index >= 50)
        other = replace(measured, diameter_m=Estimate(shifted, DIAMETER_STD_M))
        (track,) = tracker.update(frame, trees, [other])
    assert track.diameter_m.std > 2 * agreed.diameter_m.std
    assert "the views contradict each other: diameters from 0.2" in track.warnings[0]
    low, high = track.diameter_m.interval95
    assert low < 0.35
    assert high > 0.4


def test_a_diameter_whose_views_leave_it_too_uncertain_is_not_given(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng, SHARES)
    tracker = StemTracker(SETTINGS)
    for index in range(100):
        frame, trees, (measured,) = forest.observe(index / 10, (0.08 * (index - 50), 0.0), 90.0)
        value_m = 0.1 + 0.25 * (index >= 50)
        other = replace(measured, diameter_m=Estimate(value_m, DIAMETER_STD_M))
        (track,) = tracker.update(frame, trees, [other])
    assert isinstance(track.diameter_m, Failure)
    assert "the diameter is too uncertain" in track.diameter_m.reason


def test_views_elsewhere_split_the_stem(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng)
    tracker = StemTracker(SETTINGS)
    drive_past(forest, tracker, 30)
    forest.places_m = np.array([[0.0, 5.6]])
    counts = []
    for index in range(10):
        tracks = tracker.update(*forest.observe(3.0 + index / 10, (1.2, 0.0), 90.0))
        counts.append(len(tracks))
        if index == 0:
            assert tracks[0].warnings == ("the stem is elsewhere in 1 frame, not counted",)
            assert tracks[0].position_m.xyz_m[1] == pytest.approx(5.0, abs=0.1)
    assert counts[0] == 1
    assert counts[-1] == 2
    assert "split from stem 1" in tracks[1].warnings[0]
    assert tracks[1].position_m.xyz_m[1] == pytest.approx(5.6, abs=0.15)


def test_wild_frames_do_not_move_the_diameter(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng)
    tracker = StemTracker(SETTINGS)
    for index in range(40):
        frame, trees, (measured,) = forest.observe(index / 10, (0.0, 0.0), 90.0)
        if index % 8 == 7:
            measured = replace(measured, diameter_m=Estimate(0.9, DIAMETER_STD_M))
        (track,) = tracker.update(frame, trees, [measured])
    assert track.diameter_m.value == pytest.approx(0.3, abs=0.02)


def test_missing_diameters_have_their_reason(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng)
    tracker = StemTracker()
    for index in range(5):
        frame, trees, (measured,) = forest.observe(index / 10, (0.0, 0.0), 90.0)
        missing = without_diameter(measured, "the stem is half hidden")
        (track,) = tracker.update(frame, trees, [missing])
    assert track.diameter_m == Failure("the stem is half hidden")
    assert track.dbh_m == Failure("not simulated")
    assert track.more_views_help
    assert track.cut_height_m.value == pytest.approx(0.2, abs=0.1)
    (track,) = tracker.update(*forest.observe(0.5, (0.0, 0.0), 90.0))
    assert track.diameter_m.value == pytest.approx(0.3, abs=0.08)
    (track,) = tracker.update(frame, trees, [missing])
    assert track.diameter_m.value == pytest.approx(0.3, abs=0.08)


def test_stem_without_a_cut_in_view_has_a_place(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng)
    frame, trees, (measured,) = forest.observe(0.0, (0.0, 0.0), 90.0)
    no_cut = Failure("the felling cut is not in the image")
    (track,) = StemTracker().update(
        frame, trees, [replace(measured, cut_point_m=no_cut, cut_height_m=no_cut)]
    )
    assert track.position_m.xyz_m[:2] == pytest.approx([0.0, 5.0], abs=0.3)
    assert track.position_m.std_m[2] == 1.0
    assert track.cut_height_m == no_cut


def test_position_in_map_and_camera(rng):
    forest = Forest(np.array([[1.0, 5.0]]), np.array([0.3]), rng, SHARES)
    tracker = StemTracker(SETTINGS)
    drive_past(forest, tracker, 60)
    observation = forest.observe(6.0, (0.5, 0.0), 70.0)
    (track,) = tracker.update(*observation)
    assert isinstance(track.position_m, PointEstimate)
    off = np.abs(track.position_m.xyz_m - [1.0, 5.0, 0.2])
    assert (off < 3 * track.position_m.std_m).all()
    assert (track.position_m.std_m < 0.1).all()
    expected = observation[0].pose.inverse().apply(track.position_m.xyz_m)
    assert track.position_camera_m == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"memory_s": 0.0}, "memory_s is 0.0: expected a positive number"),
        ({"gate": math.nan}, "gate is nan: expected a positive number"),
    ],
)
def test_settings_are_checked(change, message):
    with pytest.raises(InputError, match=message):
        TrackingSettings(**change)
    with pytest.raises(InputError, match="expected numbers from 0 on"):
        ErrorShares(-0.1, 0.5, 0.5)


def test_errors_of_the_rig_are_the_same_in_all_frames(rng):
    forest = Forest(np.array([[0.0, 5.0]]), np.array([0.3]), rng, SHARES)
    rig_m = 0.8 * DIAMETER_STD_M
    tracker, other = StemTracker(SETTINGS), StemTracker(SETTINGS)
    for index in range(50):
        frame, trees, measured = forest.observe(index / 10, (0.08 * (index - 25), 0.0), 90.0)
        (plain,) = other.update(frame, trees, measured)
        shared = [replace(each, rig_std={"diameter_m": rig_m}) for each in measured]
        (track,) = tracker.update(frame, trees, shared)
    assert plain.diameter_m.std < rig_m < track.diameter_m.std
    rest_m = math.sqrt(track.diameter_m.std**2 - rig_m**2)
    assert rest_m == pytest.approx(0.6 * plain.diameter_m.std, rel=0.05)
