"""Widths of stems in the picture, which need neither depth nor camera."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from edgetree import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, measure_frame
from edgetree.frames.rig import Rig
from edgetree.measure import MeasureSettings, PixelSize, measure_trees, pixel_sizes

RISE_DEG = 5.0


@pytest.fixture(scope="module")
def stand(scene: Any, pole: Any) -> Any:
    lean = {"lean_deg": RISE_DEG, "lean_towards_deg": 0.0}
    return scene(pole(taper=0.04, **lean), pitch_deg=0.0)


def test_without_a_camera_the_widest_section_has_a_width_in_pixels(stand: Any) -> None:
    [size] = pixel_sizes(stand.detections(), None)
    assert isinstance(size, PixelSize)
    # 30 cm at 5 m, less the taper, by a focal length of 700 px.
    assert size.width_px.value == pytest.approx(0.3 / 4.85 * 700, abs=3)
    assert size.width_deg is None
    assert size.width_at == "widest seen section"
    assert size.lean_in_picture_deg.value == pytest.approx(RISE_DEG, abs=1.0)


def test_with_a_camera_it_has_an_angle(stand: Any) -> None:
    [size] = pixel_sizes(stand.detections(), stand.camera)
    assert isinstance(size, PixelSize)
    assert size.width_deg is not None
    expected = np.degrees(2 * np.arctan(size.width_px.value / 2 / 700))
    assert size.width_deg.value == pytest.approx(expected, rel=0.08)


def test_the_lean_is_that_from_the_given_vertical(scene: Any, pole: Any) -> None:
    stand = scene(pole(), roll_deg=8.0)
    given, from_side = (
        pixel_sizes(stand.detections(), stand.camera, up_camera=up)[0] for up in (stand.up, None)
    )
    assert abs(given.lean_in_picture_deg.value) < 1.0
    assert abs(from_side.lean_in_picture_deg.value) == pytest.approx(8.0, abs=1.0)


def test_where_breast_height_is_known_the_width_is_taken_there(stand: Any) -> None:
    trees = stand.detections()
    measured = measure_trees(trees, stand.depth_m, stand.camera, up_camera=stand.up)
    [size] = pixel_sizes(trees, stand.camera, measurements=measured)
    [widest] = pixel_sizes(trees, stand.camera)
    assert size.width_at == "breast height"
    assert size.width_px.value < widest.width_px.value - 1


def test_without_masks_the_keypoints_tell_the_width(stand: Any) -> None:
    trees = replace(stand.detections(), masks=None)
    [size] = pixel_sizes(trees, None)
    assert size.width_at == "diameter keypoints"
    across = np.subtract(*trees.keypoints_px[0, [2, 1], :2])
    assert size.width_px.value == pytest.approx(np.linalg.norm(across), rel=1e-3)


def test_a_tree_without_edges_has_a_reason(stand: Any) -> None:
    trees = stand.detections()
    blind = replace(trees, masks=np.zeros_like(trees.masks), keypoints_px=None)
    [size] = pixel_sizes(blind, None)
    assert "neither keypoints nor the mask" in size.reason


def test_a_vertical_and_measurements_that_do_not_fit_are_refused(stand: Any) -> None:
    with pytest.raises(InputError, match="expected a direction of three numbers"):
        pixel_sizes(stand.detections(), stand.camera, up_camera=(0, 0, 0))
    with pytest.raises(InputError, match="there are 0 measurements: expected 1, one per tree"):
        pixel_sizes(stand.detections(), stand.camera, measurements=[])


def test_a_frames_sizes_follow_its_settings(stand: Any) -> None:
    """Breast height is where the measurement has it."""
    frame = Frame("a", None, None, stand.depth_m, camera=stand.camera)
    found, rig = FoundTrees.detected(stand.detections()), Rig(up_camera=tuple(stand.up))
    settings = MeasureSettings(breast_height_m=2.0)

    high = measure_frame(frame, found, rig, settings).pixel_sizes[0]
    usual = measure_frame(frame, found, rig).pixel_sizes[0]

    assert (high.width_at, usual.width_at) == ("breast height", "breast height")
    # 4 % of 30 cm a metre.
    assert high.width_px.value / usual.width_px.value == pytest.approx(0.9, abs=0.03)
