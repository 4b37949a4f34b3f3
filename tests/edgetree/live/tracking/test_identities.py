"""Stems keep their numbers over occlusion, turns, low rates and lost sight."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest
from simulated_stand import Forest, detections, stand, unmeasured

from basetree.errors import InputError
from edgetree.live.tracking import StemTracker, TrackingSettings


def numbers_by_stem(forest, tracker, frames):
    """Numbers that each stem had, over (time, place, heading, options) of frames."""
    numbers = defaultdict(set)
    for time_s, place, heading_deg, options in frames:
        observation = forest.observe(time_s, place, heading_deg, **options)
        for track in tracker.update(*observation):
            if track.tree is not None:
                numbers[forest.stems_seen[track.tree]].add(track.number)
    return numbers


def circle(rate_hz, duration_s, swing_deg, **options):
    """A drive around a circle with a crane that swings."""
    for index in range(int(rate_hz * duration_s)):
        time_s = index / rate_hz
        angle = 0.15 * time_s
        heading_deg = math.degrees(angle) + 90 + swing_deg * math.sin(2 * math.pi * time_s / 8)
        yield time_s, (6 * math.cos(angle), 6 * math.sin(angle)), heading_deg, options


@pytest.mark.parametrize(
    ("options", "rate_hz", "swing_deg"),
    [
        ({}, 10, 25),
        ({"pose": False}, 10, 40),
        ({"pose": False, "vertical": False}, 10, 25),
        ({"pose": False}, 3, 25),
        ({}, 1, 20),
    ],
)
def test_stems_keep_their_numbers(rng, options, rate_hz, swing_deg):
    tracker = StemTracker()
    numbers = numbers_by_stem(stand(rng), tracker, circle(rate_hz, 20, swing_deg, **options))
    assert len(numbers) > 20
    assert sum(map(len, numbers.values())) <= len(numbers) + 2
    given = [number for each in numbers.values() for number in each]
    assert len(given) == len(set(given))
    assert tracker.map_part == 1


def test_a_number_that_another_stem_absorbs_is_told_and_not_seen_again():
    """Of two confirmed stems that turn out to be one, a map must forget the higher number."""
    forest, tracker = stand(np.random.default_rng(5), shares=(0.3, 0.3, 0.4)), StemTracker()
    kept, gone = {}, set()
    for time_s, place, heading_deg, options in circle(3, 45, 25, pose=False):
        heading_deg = (heading_deg + 180) % 360 - 180
        tracks = tracker.update(*forest.observe(time_s, place, heading_deg, **options))
        confirmed = {track.number: track for track in tracks if track.state == "confirmed"}
        assert not gone & confirmed.keys()
        absorbed = {number for track in confirmed.values() for number in track.absorbed}
        assert absorbed <= kept.keys() | gone
        gone |= absorbed
        kept = {number: each for number, each in (kept | confirmed).items() if number not in gone}
    assert gone
    places = np.array([track.position_m.xyz_m[:2] for track in kept.values()])
    gaps_m = np.linalg.norm(places[:, None] - places, axis=-1)
    assert gaps_m[~np.eye(len(gaps_m), dtype=bool)].min() > 0.8


def test_camera_is_found_by_the_stems_alone(rng):
    forest, tracker = stand(rng), StemTracker()
    start = stand(np.random.default_rng(7)).observe(0.0, (6.0, 0.0), 90.0)[0].pose
    last = None
    for frame in circle(10, 10, 20, pose=False):
        last = frame
        tracker.update(*forest.observe(*frame[:3], **frame[3]))
    assert tracker.motion.source == "stems"
    true = forest.observe(*last[:3])[0].pose.then(start.inverse())
    # The map lies at the first camera, level and heading forward.
    there = start.rotate(true.translation_m)
    found = tracker.camera_pose.translation_m
    assert np.hypot(found[0] - there[1], found[1] + there[0]) < 0.25
    assert tracker.motion.state[2] == pytest.approx(math.radians(last[2] - 90), abs=0.03)


def test_hidden_stem_returns_with_its_number(rng):
    forest, tracker = stand(rng), StemTracker(TrackingSettings(memory_s=5.0))
    visible = forest.observe(0.0, (0.0, 0.0), 0.0) and list(forest.stems_seen)
    assert len(visible) > 3
    hidden = visible[0]
    number = None
    for index in range(100):
        forest.hidden = frozenset([hidden] if 10 <= index < 50 else [])
        tracks = tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0, pose=False))
        of_stem = {forest.stems_seen[t.tree]: t.number for t in tracks if t.tree is not None}
        if index == 5:
            number = of_stem[hidden]
        if 10 <= index < 50:
            assert hidden not in of_stem
            assert any(track.number == number and track.tree is None for track in tracks)
        if index >= 50:
            assert of_stem[hidden] == number


def test_stem_is_forgotten_after_the_set_time(rng):
    forest, tracker = stand(rng), StemTracker(TrackingSettings(memory_s=2.0))
    for index in range(10):
        first = tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0))
    for index in range(10, 50):
        away = tracker.update(*forest.observe(index / 10, (0.0, 0.0), 180.0))
    again = tracker.update(*forest.observe(5.0, (0.0, 0.0), 0.0))
    old = {track.number for track in first}
    assert not old & {track.number for track in away}
    assert not old & {track.number for track in again}


def test_confirmed_after_some_frames(rng):
    forest, tracker = stand(rng), StemTracker(TrackingSettings(confirm_frames=4))
    states = [
        {t.state for t in tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0))}
        for index in range(4)
    ]
    assert states == [{"new"}, {"new"}, {"new"}, {"confirmed"}]


def test_a_single_false_detection_is_forgotten_soon(rng):
    forest, tracker = stand(rng), StemTracker()
    ghost = Forest(np.array([[4.0, 0.4]]), np.array([0.2]), rng)
    tracker.update(*ghost.observe(0.0, (0.0, 0.0), 0.0))
    forest.places_m = forest.places_m[np.linalg.norm(forest.places_m - [4.0, 0.4], axis=1) > 1.5]
    forest.diameters_m = forest.diameters_m[: len(forest.places_m)]
    for index in range(1, 15):
        tracks = tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0))
    assert 1 not in {track.number for track in tracks}


def test_two_near_stems_stay_apart(rng):
    forest = Forest(np.array([[5.0, 0.25], [5.0, -0.25]]), np.array([0.2, 0.2]), rng)
    tracker, numbers = StemTracker(), defaultdict(set)
    for index in range(60):
        forest.hidden = frozenset({1} if 20 <= index < 40 else ())
        observation = forest.observe(index / 10, (0.03 * index, 0.0), 0.0)
        for track in tracker.update(*observation):
            if track.tree is not None:
                numbers[forest.stems_seen[track.tree]].add(track.number)
    assert numbers == {0: {1}, 1: {2}} or numbers == {0: {2}, 1: {1}}


def test_two_detections_of_one_stem_are_one_track(rng):
    forest = Forest(np.array([[5.0, 0.0], [5.0, 0.02]]), np.array([0.3, 0.3]), rng)
    tracker = StemTracker()
    for index in range(20):
        tracks = tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0))
    assert len(tracks) == 1


def test_the_better_of_two_detections_is_the_stem(rng):
    forest = Forest(np.array([[5.0, 0.0], [5.0, 0.02]]), np.array([0.3, 0.3]), rng)
    tracker, chosen = StemTracker(), []
    for index in range(20):
        frame, trees, measurements = forest.observe(index / 10, (0.0, 0.0), 0.0)
        scored = replace(trees, scores=np.array([0.55, 0.99], np.float32))
        chosen.append([track.tree for track in tracker.update(frame, scored, measurements)])
    # In the first frames, the place of the stem is vague enough for either.
    assert chosen[5:] == [[1]] * 15


def test_frames_without_trees_are_bridged(rng):
    forest, tracker = stand(rng), StemTracker()
    path = list(circle(10, 6, 0, pose=False))
    for frame in path[:20]:
        before = tracker.update(*forest.observe(*frame[:3], **frame[3]))
    for frame in path[20:26]:
        live = forest.observe(*frame[:3], **frame[3])[0]
        assert len(tracker.update(live, detections([]), [])) == len(before)
        assert tracker.motion.source == "prediction"
    after = tracker.update(*forest.observe(*path[26][:3], **path[26][3]))
    assert tracker.map_part == 1
    old = {track.number for track in before if track.tree is not None}
    seen = {track.number for track in after if track.tree is not None}
    assert len(old & seen) >= len(seen) - 2


def test_unknown_motion_begins_a_new_map_and_says_so(rng):
    forest, tracker = stand(rng), StemTracker()
    for index in range(10):
        before = tracker.update(*forest.observe(index / 10, (6.0, 0.0), 90.0, pose=False))
    assert not any(track.warnings for track in before)
    other = stand(np.random.default_rng(99))
    after = tracker.update(*other.observe(60.0, (0.0, 0.0), 0.0, pose=False))
    assert tracker.map_part == 2
    assert after
    for track in after:
        assert "the map begins anew at 60.00 s" in track.warnings[0]
    assert not {track.number for track in before} & {track.number for track in after}


def test_camera_is_found_again_after_a_gap():
    forest, tracker = stand(np.random.default_rng(9)), StemTracker()
    for index in range(10):
        before = tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0, pose=False))
    after = tracker.update(*forest.observe(9.0, (0.4, 0.5), 20.0, pose=False))
    assert tracker.map_part == 1
    old = {track.number for track in before}
    assert len(old & {t.number for t in after if t.tree is not None}) >= 4


def test_the_first_pose_begins_a_map_also_where_no_stem_is_followed(rng):
    """What was seen before it is at places of another frame."""
    forest, tracker = stand(rng), StemTracker()
    for index in range(5):
        tracker.update(*forest.observe(index / 10, (6.0, 0.0), 90.0, pose=False))
    for time_s in (1.0, 31.0, 62.0):
        frame, trees, _ = forest.observe(time_s, (6.0, 0.0), 90.0, pose=False)
        assert tracker.update(frame, trees.select(np.zeros(0, int)), []) == [] or time_s < 62
    assert tracker.map_part == 1
    tracks = tracker.update(*forest.observe(62.1, (6.0, 0.0), 90.0))
    assert {track.map_part for track in tracks} == {2}


@pytest.mark.parametrize("pose", [True, False])
def test_time_that_jumps_back_keeps_the_numbers(rng, pose):
    forest, tracker = stand(rng), StemTracker()
    for index in range(10):
        before = tracker.update(*forest.observe(1000.0 + index / 10, (0.0, 0.0), 0.0, pose=pose))
    after = tracker.update(*forest.observe(3.0, (0.0, 0.0), 0.0, pose=pose))
    assert {track.number for track in before} == {track.number for track in after}
    assert {track.last_seen_s for track in after} == {3.0}


def test_time_that_jumps_back_does_not_keep_stems_for_ever(rng):
    forest, tracker = stand(rng), StemTracker(TrackingSettings(memory_s=3.0))
    for index in range(10):
        before = tracker.update(*forest.observe(1000.0 + index / 10, (0.0, 0.0), 0.0))
    for index in range(40):
        tracks = tracker.update(*forest.observe(3.0 + index / 10, (0.0, 0.0), 180.0))
    assert not {track.number for track in before} & {track.number for track in tracks}


def test_map_begins_anew_after_all_stems_were_forgotten(rng):
    forest, tracker = stand(rng), StemTracker(TrackingSettings(memory_s=2.0))
    for index in range(10):
        tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0, pose=False))
    live = forest.observe(4.0, (0.0, 0.0), 0.0, pose=False)[0]
    assert tracker.update(live, detections([]), []) == []
    after = tracker.update(*forest.observe(4.1, (0.0, 0.0), 0.0, pose=False))
    assert tracker.map_part == 2
    assert "no stem is followed that tells how the camera moved" in after[0].warnings[0]


def test_tree_without_an_axis_is_named_by_its_direction(rng):
    forest, tracker = stand(rng), StemTracker()
    for index in range(5):
        tracker.update(*forest.observe(index / 10, (0.0, 0.0), 0.0))
    frame, trees, measurements = forest.observe(0.5, (0.0, 0.0), 0.0)
    known = tracker.update(frame, trees, measurements)
    number = {track.tree: track.number for track in known}
    unseen = [unmeasured("no depth on the stem") for _ in measurements]
    named = tracker.update(forest.observe(0.6, (0.0, 0.0), 0.0)[0], trees, unseen)
    assert {t.tree: t.number for t in named if t.tree is not None} == {
        tree: number[tree] for tree in range(len(trees))
    }
    assert {t.frames for t in named if t.tree is not None} == {6}


def test_measurements_must_match_the_trees(rng):
    frame, trees, measurements = stand(rng).observe(0.0, (0.0, 0.0), 0.0)
    with pytest.raises(InputError, match=f"expected {len(trees)}, one per tree"):
        StemTracker().update(frame, trees, measurements[1:])


@pytest.mark.parametrize("pose", [True, False])
def test_a_vertical_by_which_all_stems_lie_is_told(rng, caplog, pose):
    forest, tracker = stand(rng), StemTracker()
    for index in range(6):
        frame, *seen = forest.observe(index / 10, (0.2 * index, 0), 0, pose=pose)
        turned = {"pose": frame.pose.inverse()} if pose else {"up_camera": (0.0, 0.0, 1.0)}
        assert tracker.update(replace(frame, **turned), *seen) == []
    (line,) = (line for line in caplog.messages if "lie on the ground" in line)
    assert ("frames' poses" if pose else "frames' vertical") in line
