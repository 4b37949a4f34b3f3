"""The sample frames are complete and their ground truth fits their images."""

from __future__ import annotations

import numpy as np
import pytest

from edgetree.samples import SampleFrame, sample_frames

FRAMES = sample_frames()


def test_there_are_six_with_trees() -> None:
    assert len(FRAMES) == 6
    assert all(frame.trees for frame in FRAMES)


@pytest.mark.parametrize("frame", FRAMES, ids=lambda frame: frame.name)
def test_image_depth_camera_and_truth_have_one_size(frame: SampleFrame) -> None:
    image, depth_m = frame.image(), frame.depth_m()
    size = (frame.camera.height, frame.camera.width)
    assert image.shape == (*size, 3)
    assert depth_m.shape == size
    assert np.linalg.norm(frame.up_camera) == pytest.approx(1.0, abs=1e-3)
    assert frame.up_camera[1] < -0.8, "up is against the camera's y axis"
    for tree in frame.trees:
        x0, y0, x1, y1 = tree.box_px
        assert 0 <= x0 < x1 <= frame.camera.width
        assert 0 <= y0 < y1 <= frame.camera.height
        assert tree.keypoints_px.shape == (5, 3)
        assert 0.03 < tree.diameter_m < 1.5


def test_depth_at_visible_keypoints_is_the_trees_distance() -> None:
    checked = 0
    for frame in FRAMES:
        depth_m = frame.depth_m()
        for tree in frame.trees:
            x, y, flag = tree.keypoints_px[3]
            if flag == 2 and tree.visible_fraction > 0.9:
                found_m = depth_m[int(y), int(x)]
                if found_m == 0:  # the sensor read nothing there
                    continue
                assert abs(found_m - tree.distance_m) < 0.35 * tree.distance_m
                checked += 1
    assert checked >= 6
