"""Trees beyond the reach of a model's labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from basetree.arrays import Float32
from calib import PinholeCamera
from edgetree import TreeDetections, TreeDetector, default_model, sample_frames
from edgetree.errors import InputError
from edgetree.runtime import FakeSession
from edgetree.runtime.reach import stem_distances_m, within_reach

WIDTH, HEIGHT, FOCAL_PX = 640, 480, 400.0
CAMERA = PinholeCamera(WIDTH, HEIGHT, FOCAL_PX, FOCAL_PX, WIDTH / 2 - 0.5, HEIGHT / 2 - 0.5)
REACH_M = 10.0


def trees(*boxes: tuple[float, float, float, float]) -> TreeDetections:
    """Trees whose masks fill the middle half of their boxes' columns."""
    masks = np.zeros((len(boxes), 28, 28), np.float32)
    masks[:, :, 7:21] = 1.0
    scores = np.linspace(0.9, 0.8, len(boxes)).astype(np.float32)
    return TreeDetections(np.array(boxes, np.float32), scores, None, masks, WIDTH, HEIGHT)


def stems_m(found: TreeDetections, depths_m: list[float]) -> Float32:
    """(H, W) depth of a wall 20 m away, with a stem at a depth in the middle of each box."""
    depth_m = np.full((HEIGHT, WIDTH), 20.0, np.float32)
    for (left, top, right, bottom), z_m in zip(found.boxes_px.tolist(), depths_m, strict=True):
        quarter = (right - left) / 4
        columns = slice(round(left + quarter), round(right - quarter))
        depth_m[round(top) : round(bottom), columns] = z_m
    return depth_m


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
    manifest = TreeDetector.load(default_model("depth")).manifest
    found = trees((310, 100, 330, 240), (600, 100, 620, 240))
    scale = min(manifest.input.width / WIDTH, manifest.input.height / HEIGHT)
    session = FakeSession.with_trees(
        manifest, found.boxes_px * np.float32(scale), found.scores, masks=found.masks
    )
    detector = TreeDetector(session)
    depth_m = stems_m(found, [9.0, 9.0])

    assert len(detector.detect(depth_m)) == 2
    np.testing.assert_allclose(
        detector.detect(depth_m, camera=CAMERA).boxes_px, found.boxes_px[:1], atol=0.1
    )

    unlimited = FakeSession.with_trees(
        replace(manifest, reach_m=None),
        found.boxes_px * np.float32(scale),
        found.scores,
        masks=found.masks,
    )
    assert len(TreeDetector(unlimited).detect(depth_m, camera=CAMERA)) == 2


def test_a_camera_of_another_size_is_refused() -> None:
    detector = TreeDetector.load(default_model("depth"))

    with pytest.raises(InputError, match="the camera is for 640x480 px and the image has"):
        detector.detect(sample_frames()[0].depth_m(), camera=CAMERA)
