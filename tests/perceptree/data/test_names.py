"""Mapping of categories and keypoints of other datasets, with notes."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from perceptree.data import Dataset, read_dataset
from perceptree.data.names import means_tree
from perceptree.errors import DatasetError

Content = dict[str, Any]
Edit = Callable[[Path, str, Callable[[Content], None]], None]
Reread = Callable[[Callable[[Content], None]], Dataset]


@pytest.fixture
def reread(posts: Path, edit_split: Edit) -> Reread:
    def read(change: Callable[[Content], None]) -> Dataset:
        edit_split(posts, "train", change)
        return read_dataset(posts, "train")

    return read


def _trees(dataset: Dataset) -> int:
    return sum(len(frame.trees) for frame in dataset.frames)


@pytest.mark.parametrize(
    ("name", "tree"),
    [
        ("tree", True),
        ("Tree", True),
        ("tree_trunk", True),
        ("TreeStem", True),
        ("trunks", True),
        ("Norway spruce", True),
        ("stump", False),
        ("tree stump", False),
        ("fallen tree", False),
        ("person", False),
        ("street", False),
        ("system", False),
        ("tree-crown", False),
    ],
)
def test_names_that_mean_a_standing_tree(name: str, tree: bool) -> None:
    assert means_tree(name) == tree


def test_a_single_category_is_trees_with_a_note(reread: Reread) -> None:
    dataset = reread(lambda content: content["categories"][0].update(name="Objekt"))
    assert _trees(dataset) == 9
    assert dataset.notes == ("category 'Objekt', the only one, is taken as trees",)


def test_of_several_categories_those_named_tree_are_taken(reread: Reread) -> None:
    def change(content: Content) -> None:
        names = ["keypoints"], content["categories"][0]["keypoints"]
        content["categories"] = [
            {"id": 3, "name": "person"},
            {"id": 5, "name": "trunk", names[0][0]: names[1]},
            {"id": 6, "name": "stump"},
        ]
        for number, annotation in enumerate(content["annotations"]):
            annotation["category_id"] = (5, 5, 3, 6)[number % 4]

    dataset = reread(change)
    assert _trees(dataset) == 5
    assert dataset.notes == (
        "taken as trees: 'trunk'; left out: 'person' (2 labels), 'stump' (2 labels)",
    )


def test_no_category_named_tree_is_one_line_that_names_them(reread: Reread) -> None:
    def change(content: Content) -> None:
        content["categories"] = [{"id": 1, "name": "car"}, {"id": 2, "name": "person"}]

    with pytest.raises(DatasetError, match=r"categories 'car', 'person' means tree.*named 'tree'"):
        reread(change)


def test_an_unknown_category_is_rejected(reread: Reread) -> None:
    with pytest.raises(DatasetError, match="category_id of annotation 2 is 9, expected"):
        reread(lambda content: content["annotations"][1].update(category_id=9))


def test_without_categories_everything_is_a_tree(reread: Reread) -> None:
    dataset = reread(lambda content: content.pop("categories"))
    assert _trees(dataset) == 9
    assert dataset.has_keypoints
    assert "no categories" in dataset.notes[0]
    assert "taken as felling_cut, diameter_left" in dataset.notes[1]


def test_reordered_and_extra_keypoints_are_mapped(reread: Reread) -> None:
    before = reread(lambda content: None).frames[1].trees[1].keypoints

    def change(content: Content) -> None:
        content["categories"][0]["keypoints"] = ["AX2", "knot", "kpR", "kpCP", "ax1", "kpL"]
        for annotation in content["annotations"]:
            points = [annotation["keypoints"][3 * k : 3 * k + 3] for k in range(5)]
            moved = [points[4], [5, 5, 2], points[2], points[0], points[3], points[1]]
            annotation["keypoints"] = [value for point in moved for value in point]

    dataset = reread(change)
    assert (dataset.frames[1].trees[1].keypoints == before).all()
    assert dataset.notes == ("keypoints left out: knot",)


def test_a_subset_of_the_keypoints_is_mapped(reread: Reread) -> None:
    def change(content: Content) -> None:
        content["categories"][0]["keypoints"] = ["kpR", "kpCP"]
        for annotation in content["annotations"]:
            points = annotation["keypoints"]
            annotation["keypoints"] = points[6:9] + points[:3]

    before = reread(lambda content: None).frames[0].trees[0].keypoints
    dataset = reread(change)
    found = dataset.frames[0].trees[0].keypoints
    assert (found[[0, 2]] == before[[0, 2]]).all()
    assert not found[[1, 3, 4]].any()
    assert dataset.notes == ("the file has no keypoint diameter_left, axis_middle, axis_top",)


@pytest.mark.parametrize(
    ("names", "count"), [(["nose", "left_eye", "right_eye", "top", "tail"], 5), (None, 3)]
)
def test_unknown_keypoints_are_left_out_with_a_note(
    reread: Reread, names: list[str] | None, count: int
) -> None:
    def change(content: Content) -> None:
        content["categories"][0]["keypoints"] = names
        for annotation in content["annotations"]:
            annotation["keypoints"] = annotation["keypoints"][: 3 * count]

    dataset = reread(change)
    assert not dataset.has_keypoints
    assert not any(t.keypoints.any() for frame in dataset.frames for t in frame.trees)
    assert dataset.notes[0].startswith("keypoints are left out: ")
    assert _trees(dataset) == 9


def test_a_keypoint_far_outside_its_frame_is_not_labelled_and_counted(reread: Reread) -> None:
    def change(content: Content) -> None:
        content["annotations"][0]["keypoints"][:3] = [99999, 20, 2]
        content["annotations"][1]["keypoints"][3:6] = [40, -8, 1]
        content["annotations"][1]["keypoints"][6:9] = [128.4, 71.9, 2]  # 0.9 px outside

    dataset = reread(change)
    first, second = (tree for frame in dataset.frames[:2] for tree in frame.trees[:1])
    assert first.keypoints[0].tolist() == [0, 0, 0]
    assert first.keypoints[1, 2] == 2
    assert second.keypoints[1].tolist() == [0, 0, 0]
    assert second.keypoints[2].tolist() == [128, 72, 2]
    assert dataset.tally.outside == [(1, 99999, 20), (2, 40, -8)]
    assert dataset.notes == (
        "2 keypoints are outside their frame and count as not labelled, the first at x = 99999,"
        " y = 20 of annotation 1",
    )


def test_missing_masks_and_keypoints_are_noted(reread: Reread) -> None:
    def change(content: Content) -> None:
        for annotation in content["annotations"]:
            del annotation["keypoints"]
            annotation["segmentation"] = []

    dataset = reread(change)
    assert (dataset.has_masks, dataset.has_keypoints, dataset.has_depth) == (False, False, True)
    assert all(tree.segmentation is None for frame in dataset.frames for tree in frame.trees)
    assert dataset.notes == ("the set has no masks", "no tree has a labelled keypoint")
    with pytest.raises(DatasetError, match="annotation 1 has no mask"):
        dataset.frames[0].mask(dataset.frames[0].trees[0])


def test_a_crowd_needs_no_mask(reread: Reread) -> None:
    dataset = reread(lambda content: content["annotations"][0].update(segmentation=None, iscrowd=1))
    assert dataset.has_masks
    assert dataset.frames[0].trees[0].crowd
