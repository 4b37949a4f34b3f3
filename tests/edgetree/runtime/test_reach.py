"""Trees beyond the reach of a model's labels."""

from __future__ import annotations

import numpy as np
import pytest
from stems_at_a_distance import (
    CAMERA,
    FOCAL_PX,
    PAIR,
    PAIR_M,
    REACH_M,
    WIDTH,
    faked,
    stems_m,
    trees,
)

from calib import DepthEncoding, encode_depth
from edgetree import TreeDetector, default_model, sample_frames
from edgetree.errors import InputError
from edgetree.frames import Frame, Rig
from edgetree.frames.pipeline import find_trees
from edgetree.runtime.reach import stem_distances_m, within_reach


def test_a_distance_is_along_the_ray_and_to_the_axis() -> None:
    found = trees((310, 100, 330, 240), (600, 100, 620, 240))

    distance_m = stem_distances_m(found.boxes_px, found.masks, stems_m(found, [8.0, 8.0]), CAMERA)

    radius_m = 8.0 * 5 / FOCAL_PX
    aside = np.hypot(1.0, (610 - WIDTH / 2) / FOCAL_PX)
    np.testing.assert_allclose(distance_m, [8.0 + radius_m, 8.0 * aside + radius_m], atol=1e-3)


def test_the_score_of_a_tree_out_of_reach_falls() -> None:
    # Of the same depth, one in the middle of the picture and one at its edge.
    found = trees((600, 100, 620, 240), (310, 100, 330, 240))

    seen = within_reach(found, stems_m(found, [9.0, 9.0]), CAMERA, REACH_M)

    np.testing.assert_array_equal(seen.boxes_px[:, 0], [310, 600])
    assert seen.scores[0] == found.scores[1]
    assert seen.scores[1] < 0.01


def test_at_the_reach_the_score_is_halved() -> None:
    found = trees((310, 100, 330, 240))
    z_m = REACH_M / (1 + 5 / FOCAL_PX)

    seen = within_reach(found, stems_m(found, [z_m]), CAMERA, REACH_M)

    assert seen.scores[0] == pytest.approx(found.scores[0] / 2, rel=0.01)


def test_a_stem_without_readings_keeps_its_score() -> None:
    """Of the wall behind it, single pixels at its edge show."""
    found = trees((300, 100, 340, 240), (-30, 100, -5, 240))
    depth_m = stems_m(found.select(slice(1)), [np.nan])
    depth_m[120:240:9, 312:328:4] = 20.0

    seen = within_reach(found, depth_m, CAMERA, REACH_M)

    np.testing.assert_array_equal(seen.scores, found.scores)


def test_only_the_lower_half_of_a_stem_counts() -> None:
    """A stem that leans away from the camera stands where its foot is."""
    found = trees((310, 100, 330, 240))
    depth_m = stems_m(found, [9.0])
    depth_m[100:170, 310:330] = 12.0

    seen = within_reach(found, depth_m, CAMERA, REACH_M)

    np.testing.assert_array_equal(seen.scores, found.scores)


def test_a_detector_leaves_out_what_its_labels_leave_out() -> None:
    seen = faked(PAIR).detect(PAIR_M, camera=CAMERA)

    np.testing.assert_allclose(seen.boxes_px, PAIR.boxes_px[:1], atol=0.1)
    assert len(faked(PAIR).detect(PAIR_M)) == 2
    assert len(faked(PAIR, reach_m=None).detect(PAIR_M, camera=CAMERA)) == 2


def test_each_image_of_a_batch_has_its_own_camera() -> None:
    detector = faked(PAIR)

    near, all_found = detector.detect_batch([PAIR_M, PAIR_M], cameras=[CAMERA, None])

    assert (len(near), len(all_found)) == (1, 2)
    with pytest.raises(InputError, match="1 cameras for 2 images: expected one of each"):
        detector.detect_batch([PAIR_M, PAIR_M], cameras=[CAMERA])
    with pytest.raises(InputError, match=r"images\[1\]: the camera is for 320x"):
        detector.detect_batch([PAIR_M, PAIR_M], cameras=[None, CAMERA.scaled(320, 240)])


def test_the_packaged_depth_files_know_their_reach() -> None:
    models = [default_model("depth"), "edge-s-depth"]

    assert {TreeDetector.load(model).manifest.reach_m for model in models} == {10.0}


def test_encoded_depth_tells_distances_too() -> None:
    detector = faked(PAIR)
    assert detector.manifest.depth_encoding is not None
    encoding = DepthEncoding.from_dict(dict(detector.manifest.depth_encoding))

    assert len(detector.detect(encode_depth(PAIR_M, encoding), camera=CAMERA)) == 1


@pytest.mark.parametrize(
    ("frame", "rig", "count"),
    [
        (Frame("a", None, None, PAIR_M, camera=CAMERA), Rig(), 1),
        (Frame("a", None, None, PAIR_M), Rig(camera=CAMERA.scaled(1280, 960)), 1),
        (Frame("a", None, None, PAIR_M), Rig(), 2),
        (Frame("a", None, None, PAIR_M, depth_fault="late", camera=CAMERA), Rig(), 2),
    ],
    ids=["own camera", "camera of the rig", "no camera", "unusable depth"],
)
def test_a_frame_with_depth_and_camera_has_the_trees_within_reach(
    frame: Frame, rig: Rig, count: int
) -> None:
    assert len(find_trees(frame, faked(PAIR), rig).trees) == count


def test_a_camera_on_its_side_sees_the_same_trees() -> None:
    """The picture is turned for the model, and its camera with it."""
    turned_m = np.ascontiguousarray(np.rot90(PAIR_M))
    frame = Frame("a", None, None, turned_m, camera=CAMERA.rotated(270))

    (box,) = find_trees(frame, faked(PAIR), Rig(rotation_deg=90)).trees.boxes_px

    np.testing.assert_allclose(box, [100, 310, 240, 330], atol=0.1)


def test_a_camera_of_another_size_is_refused() -> None:
    detector = TreeDetector.load(default_model("depth"))

    with pytest.raises(InputError, match="the camera is for 640x480 px and the image has"):
        detector.detect(sample_frames()[0].depth_m(), camera=CAMERA)
