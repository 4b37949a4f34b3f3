"""Trees are drawn at their positions, on a copy of the picture."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from edgetree.detections import TreeDetections
from edgetree.drawing.label_placement import Rect, place_label
from edgetree.drawing.trees import CutMark, draw_trees, picture_of_depth
from edgetree.samples import sample_frames


def _trees(width: int = 640, height: int = 360) -> TreeDetections:
    keypoints = [
        [x, y, 0.5] for x, y in ((110, 300), (100, 280), (120, 280), (110, 230), (110, 180))
    ]
    return TreeDetections(
        boxes_px=np.array([[95, 100, 125, 305]], np.float32),
        scores=np.array([0.9], np.float32),
        keypoints_px=np.array([keypoints], np.float32),
        masks=np.ones((1, 28, 28), np.float32),
        image_width=width,
        image_height=height,
    )


def _changed(trees: TreeDetections, labels: list[list[str]]) -> NDArray[np.bool_]:
    picture = np.full((trees.image_height, trees.image_width, 3), 50, np.uint8)
    drawn = draw_trees(picture, trees, labels)
    assert (picture == 50).all(), "the given picture was drawn on"
    return np.asarray((drawn != picture).any(axis=2))


def test_the_mask_the_keypoints_and_the_box_are_drawn() -> None:
    changed = _changed(_trees(), [[]])
    assert changed[_trees().mask(0)].all()
    without_mask = dataclasses.replace(_trees(), masks=None)
    changed = _changed(without_mask, [[]])
    assert changed[100, 95]
    assert changed[304, 124]
    for x, y in ((110, 299), (100, 279), (120, 279), (110, 229), (110, 180)):
        assert changed[y, x], f"nothing is drawn at the keypoint {x}, {y}"
    assert not changed[:, 140:].any()


def test_the_label_is_next_to_the_stem_and_inside_the_picture() -> None:
    label = ["Ø 0.312 ±0.008 m", "cut 0.15 m  dist 4.2 m"]
    bare, labelled = _changed(_trees(), [[]]), _changed(_trees(), [label])
    label = labelled & ~bare
    assert label.sum() > 2000
    assert not (label & _trees().mask(0)).any()


def _side_by_side(distance_px: float) -> TreeDetections:
    one = _trees()
    assert one.keypoints_px is not None
    box_shift = np.array([distance_px, 0, distance_px, 0], np.float32)
    point_shift = np.array([distance_px, 0, 0], np.float32)
    return TreeDetections(
        boxes_px=np.concatenate([one.boxes_px, one.boxes_px + box_shift]),
        scores=np.array([0.9, 0.8], np.float32),
        keypoints_px=np.concatenate([one.keypoints_px, one.keypoints_px + point_shift]),
        masks=np.ones((2, 28, 28), np.float32),
        image_width=one.image_width,
        image_height=one.image_height,
    )


def _labels(trees: TreeDetections, labels: list[list[str]]) -> NDArray[np.bool_]:
    """Pixels that change with labels: the labels and their leader lines."""
    picture = np.full((trees.image_height, trees.image_width, 3), 50, np.uint8)
    bare = draw_trees(picture, trees, [[] for _ in labels])
    return np.asarray((draw_trees(picture, trees, labels) != bare).any(axis=2))


def test_labels_do_not_cover_each_other() -> None:
    label = ["Ø 0.312 ±0.008 m"]
    both = _side_by_side(0)
    one = _labels(both, [label, []]).sum()
    assert _labels(both, [label, label]).sum() > 1.9 * one


def test_labels_do_not_cover_a_neighbours_stem() -> None:
    label = ["Ø 0.312 ±0.008 m"]
    both = _side_by_side(60)
    labels = _labels(both, [label, []])
    assert labels.sum() > 1000
    for index in range(2):
        assert (labels & both.mask(index)).sum() < 30


def test_a_tree_at_the_edge_and_a_tiny_picture_are_drawn() -> None:
    edge = dataclasses.replace(_trees(40, 30), boxes_px=np.array([[-20, -10, 60, 45]], np.float32))
    assert _changed(edge, [["a label far longer than the picture is wide"]]).any()


def test_points_far_outside_the_picture_are_drawn_to_its_edge() -> None:
    trees = _trees()
    assert trees.keypoints_px is not None
    keypoints_px = trees.keypoints_px.copy()
    keypoints_px[0, 0, :2] = (1e9, -1e9)
    keypoints_px[0, 4, :2] = (110, -1e9)
    far = dataclasses.replace(trees, keypoints_px=keypoints_px, masks=None)
    assert _changed(far, [["label"]])[0, 110]


def _ink(trees: TreeDetections, **more: Any) -> NDArray[np.uint8]:
    picture = np.full((trees.image_height, trees.image_width, 3), 50, np.uint8)
    return draw_trees(picture, trees, [[] for _ in trees.scores], **more)


def test_a_measured_cut_is_drawn_with_its_height() -> None:
    at_keypoint = _ink(_trees())
    moved = _ink(_trees(), cuts=[CutMark((112.0, 250.0), "")])
    assert (at_keypoint[300, 110] == (60, 60, 255)).all()
    assert (moved[250, 112] == (60, 60, 255)).all()
    assert not (moved[304, 112] == (60, 60, 255)).all()
    told = _ink(_trees(), cuts=[CutMark((112.0, 250.0), "15 cm")])
    beside = (told != moved).any(axis=2)
    assert beside[240:260, 120:180].sum() > 300
    assert not beside[:, 180:].any()


def _profile(step_px: float) -> NDArray[np.floating[Any]]:
    """Ends of diameters of 20 px around x = 110 px, from y = 250 px upwards."""
    level_px = np.arange(250.0, 120.0, -step_px)
    ends = np.stack([np.full((len(level_px), 2), (100.0, 120.0)), np.stack([level_px] * 2, 1)], -1)
    return np.asarray(ends)


def test_the_diameters_of_a_profile_are_ticks_at_the_edges() -> None:
    plain, ticked = _ink(_trees()), _ink(_trees(), profiles=[_profile(20.0)])
    rows = np.flatnonzero((ticked != plain)[:, 101].any(axis=1))
    assert len(rows) >= 7
    for level in np.arange(250, 120, -20):
        assert np.abs(rows - level).min() <= 1
    assert (ticked[:, 112] == plain[:, 112]).all(), "ticks leave the middle of the stem free"


def test_dense_diameters_have_fewer_ticks() -> None:
    plain, dense = _ink(_trees()), _ink(_trees(), profiles=[_profile(2.0)])
    rows = np.flatnonzero((dense != plain)[:, 101].any(axis=1))
    assert 7 <= len(rows) <= 40


@pytest.mark.parametrize("x_px", [2.0, 630.0])
def test_the_height_of_a_cut_stays_in_the_picture(x_px: float) -> None:
    bare = dataclasses.replace(_trees(), keypoints_px=None, masks=None)
    one, other = (_ink(bare, cuts=[CutMark((x_px, 355.0), text)]) for text in ("15 cm", "75 cm"))
    assert (one != other).any(), "the text is not cut off"


def test_given_masks_replace_the_models_masks() -> None:
    given = np.zeros((360, 640), np.bool_)
    given[200:220, 400:420] = True
    bare = dataclasses.replace(_trees(), keypoints_px=None)
    drawn = (_ink(bare, masks=[given]) != 50).any(axis=2)
    assert drawn[given].all()
    assert not drawn[150, 110]


def test_only_a_line_with_a_warning_sign_is_amber() -> None:
    both = _side_by_side(200)
    bare = _ink(both).astype(int)

    def amber_rows(lines: list[str]) -> int:
        """Number of rows between the first and last amber pixel; the tree's colour is blue."""
        picture = np.full((360, 640, 3), 50, np.uint8)
        blue, _, red = np.moveaxis(draw_trees(picture, both, [[], lines]).astype(int), 2, 0)
        amber = (red - blue > 60) & ~(bare[..., 2] - bare[..., 0] > 60)
        return int(np.ptp(np.flatnonzero(amber.any(1)))) if amber.any() else 0

    assert amber_rows(["31 cm", "28 cm"]) == 0
    one = amber_rows(["31 cm !", "28 cm"])
    assert 3 < one < 19, "one line high"
    assert amber_rows(["31 cm !", "28 cm !"]) > one + 10


def test_eight_large_labels_do_not_overlap() -> None:
    stems = np.array([[x, 40, x + 40, 700] for x in range(40, 1240, 150)], np.float64)
    labels: list[Rect] = []
    for x0, _, x1, _ in stems:
        labels.append(place_label((260, 110), (x0, x1, 640), labels, stems, (1280, 720)))
    covered = np.zeros((720, 1280), int)
    for x0, y0, x1, y1 in labels:
        assert 0 <= x0 < x1 <= 1280
        assert 0 <= y0 < y1 <= 720
        covered[y0:y1, x0:x1] += 1
    assert covered.max() == 1


def test_a_label_is_placed_where_it_hides_no_stem() -> None:
    stems = np.array([[0, 0, 36, 350], [46, 0, 80, 350]], np.float64)
    x0, y0, _, y1 = place_label((90, 40), (0, 36, 200), [], stems, (640, 360))
    assert 80 <= x0 < 100, "to the right of the neighbour too"
    assert y0 < 200 < y1


def test_a_drawn_sample_frame_looks_as_it_did(
    check_golden_picture: Callable[[str, NDArray[np.uint8]], None],
) -> None:
    """Masks, boxes, keypoints, labels with a warning, and a measured cut, at a quarter's size."""
    frame = sample_frames()[0]
    width, height, scale = 320, 180, np.float32(0.25)
    picture = cv2.resize(frame.image(), (width, height), interpolation=cv2.INTER_AREA)
    known = [tree for tree in frame.trees if tree.keypoints_px[:, 2].all()]
    count = len(known)
    assert count >= 3
    grid = np.minimum(np.arange(28), 27 - np.arange(28)) / 14
    trees = TreeDetections(
        boxes_px=np.stack([tree.box_px for tree in known]) * scale,
        scores=np.linspace(0.9, 0.6, count, dtype=np.float32),
        keypoints_px=np.stack([tree.keypoints_px for tree in known])
        * np.array([scale, scale, 0.5], np.float32),
        masks=np.tile(0.3 + grid, (count, 28, 1)).astype(np.float32),
        image_width=width,
        image_height=height,
    )
    labels = [[f"{index + 1}", "31 cm !", "28 cm"][: 1 + index % 3] for index in range(count)]
    cuts = [CutMark((40.0, 150.0), "15 cm"), *[None] * (count - 1)]
    check_golden_picture("drawn_trees.png", draw_trees(picture, trees, labels, cuts=cuts))


def test_depth_without_reading_is_black() -> None:
    depth_m = np.array([[0.0, 1.0, 19.0, 99.0]], np.float32)
    picture = picture_of_depth(depth_m)
    assert picture.shape == (1, 4, 3)
    assert (picture[0, 0] == 0).all()
    near, far, beyond = (int(picture[0, column].sum()) for column in (1, 2, 3))
    assert near > far > 0, "near is bright"
    assert beyond > 0, "what is far has a reading"
