"""What the page is told of the stems, and how they are drawn."""

import dataclasses
import json

import numpy as np
import pytest
from schema_check import check_schema
from simulated_stand import stand

from edgetree.drawing.trees import tree_colour
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.live.page import page_record
from edgetree.live.page.pictures import draw_result, encode_jpeg
from edgetree.live.results import followed
from edgetree.live.tracking import StemTracker
from edgetree.measure import Failure


def test_stems_in_view_come_first_then_the_nearer_ones(live_result) -> None:
    record = page_record(live_result(stems=5))
    assert check_schema(record) == "edgetree.live.page/1"
    stems = record["stems"]
    assert [stem["number"] for stem in stems] == [1, 2, 3, 4, 5]
    assert [stem["in_view"] for stem in stems] == [True] * 4 + [False]
    assert stems[0]["distance_m"] < stems[3]["distance_m"]


def test_a_stem_has_its_metres_with_standard_deviations(live_result) -> None:
    stem = page_record(live_result())["stems"][1]
    assert stem["diameter_m"] == pytest.approx(0.222)
    assert stem["diameter_std_m"] == pytest.approx(0.006)
    assert stem["cut_height_m"] == pytest.approx(0.12)
    assert stem["inclination_std_deg"] == pytest.approx(0.8)
    assert (stem["views"], stem["unseen_s"], stem["plan_std_m"]) == (5, 0.0, 0.05)


def test_what_was_not_measured_has_its_reason(live_result) -> None:
    stem = page_record(live_result(diameter_m=Failure("no depth on the stem")))["stems"][0]
    assert stem["diameter_failure"] == "no depth on the stem"
    assert "diameter_m" not in stem
    record = page_record(live_result(measured=False))
    check_schema(record)
    assert (record["stems"], record["metres_need"]) == ([], "no depth")


def test_the_plan_is_level_whatever_the_camera_looks_at(live_result) -> None:
    result = live_result(position_camera_m=np.array([1.0, 0.0, 5.0]))
    tilt = np.radians(30)  # the camera looks down
    up = np.array([0.0, -np.cos(tilt), -np.sin(tilt)])
    tilted = dataclasses.replace(result, frame=dataclasses.replace(result.frame, up_camera=up))
    assert page_record(result)["stems"][0]["plan_m"] == pytest.approx([1.0, 5.0])
    expected = [1.0, 5.0 * np.cos(tilt)]
    assert page_record(tilted)["stems"][0]["plan_m"] == pytest.approx(expected, abs=1e-3)
    down = dataclasses.replace(
        result, frame=dataclasses.replace(result.frame, up_camera=np.array([0.0, 0.0, -1.0]))
    )
    assert page_record(down)["stems"][0]["plan_m"] == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("told", [{"pose": True}, {"pose": False}])
def test_the_plan_is_level_by_poses_and_by_the_stems_too(told) -> None:
    """The camera looks down by 8 degrees, from 2.3 m above the cuts."""
    forest, tracker = stand(np.random.default_rng(7)), StemTracker()
    for index in range(5):
        frame, trees, measured = forest.observe(index / 10, (0.0, 0.0), 0.0, vertical=False, **told)
        found = FoundTrees.detected(trees)
        result = followed(FrameResult(frame, found, measured, None), tracker)
    true_m = np.hypot(*forest.places_m.T)
    tracks = {track.number: track.tree for track in result.tracks}
    stems = [stem for stem in page_record(result)["stems"] if stem["in_view"]]
    off_m = [
        stem["distance_m"] - true_m[forest.stems_seen[tracks[stem["number"]]]] for stem in stems
    ]
    assert len(off_m) > 3
    assert abs(np.mean(off_m)) < 0.08


def test_the_field_of_view_is_that_of_the_camera(live_result) -> None:
    left, right = page_record(live_result())["field_of_view_deg"]
    assert (left, right) == pytest.approx((-38.7, 38.7), abs=0.1)


def test_results_of_the_sample_frames_can_be_shown(sample_results) -> None:
    stems = 0
    for result in sample_results:
        record = page_record(result)
        stems += len(record["stems"])
        json.dumps(record, allow_nan=False)
        drawn = draw_result(result)
        assert drawn.shape == result.frame.image.shape
        assert len(encode_jpeg(drawn)) < 400_000
    assert stems > 10


def test_followed_stems_have_a_tag_in_their_colour(live_result) -> None:
    result = live_result(stems=3)
    drawn = draw_result(result)
    for number in (1, 2):
        assert (drawn == tree_colour(number)).all(-1).sum() > 150
    assert not (drawn == tree_colour(3)).all(-1).any()  # not in view
    bare = draw_result(dataclasses.replace(result, tracks=[]))
    assert not (bare == tree_colour(1)).all(-1).any()


def test_frames_without_a_colour_image_are_drawn(live_result) -> None:
    result = live_result()
    depth_m = np.full((360, 640), 5.0, np.float32)
    for depth in (depth_m, None):
        frame = dataclasses.replace(result.frame, image=None, depth_m=depth)
        assert draw_result(dataclasses.replace(result, frame=frame)).shape == (360, 640, 3)
