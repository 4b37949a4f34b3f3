"""Run lengths with iscrowd 1, as CVAT writes masks painted with a brush."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from perceptree.data import read_dataset
from perceptree.data.check import Check

Content = dict[str, Any]
Edit = Callable[[Path, str, Callable[[Content], None]], None]
Call = Callable[..., tuple[int, str, str]]
SPLITS = ("train", "val", "test")


def crowd(edit: Edit, posts: Path, **more: Any) -> None:
    """Mark all annotations of all splits as crowds."""

    def change(content: Content) -> None:
        for annotation in content["annotations"]:
            annotation.update(iscrowd=1, **more)

    for split in SPLITS:
        edit(posts, split, change)


def test_run_lengths_with_keypoints_are_trees(posts: Path, edit_split: Edit) -> None:
    crowd(edit_split, posts)
    dataset = read_dataset(posts, "train")
    trees = [tree for frame in dataset.frames for tree in frame.trees]
    assert (len(trees), sum(tree.ignored for tree in trees)) == (9, 0)
    assert "9 run lengths with iscrowd 1 are taken as trees, as they have keypoints" in str(
        dataset.notes
    )


@pytest.mark.parametrize("keypoints", [None, [], [0] * 15])
def test_run_lengths_without_keypoints_are_crowds_that_are_told(
    posts: Path, edit_split: Edit, keypoints: Any
) -> None:
    crowd(edit_split, posts, keypoints=keypoints)
    dataset = read_dataset(posts, "train")
    assert all(tree.ignored for frame in dataset.frames for tree in frame.trees)
    assert dataset.notes[0] == (
        "9 run lengths with iscrowd 1 are crowds, neither trained nor counted; CVAT marks each mask"
        " painted with a brush so: --crowds-as-trees takes them as trees"
    )
    assert [split.trees for split in Check(posts).run().splits] == [0, 0, 0]
    taken = read_dataset(posts, "train", crowds_as_trees=True)
    assert not any(tree.ignored for frame in taken.frames for tree in frame.trees)
    assert taken.notes[0] == (
        "9 run lengths with iscrowd 1 are taken as trees, by --crowds-as-trees"
    )


@pytest.mark.parametrize("mask", [None, [[1, 1, 20, 1, 20, 30]]])
def test_crowds_of_boxes_and_polygons_stay_crowds(posts: Path, edit_split: Edit, mask: Any) -> None:
    def change(content: Content) -> None:
        content["annotations"][3].update(iscrowd=1, segmentation=mask)

    edit_split(posts, "train", change)
    dataset = read_dataset(posts, "train", crowds_as_trees=True)
    ignored = [tree.number for frame in dataset.frames for tree in frame.trees if tree.ignored]
    assert ignored == [4]


def test_the_commands_count_crowds_and_take_them_by_an_option(
    posts: Path, edit_split: Edit, call: Call, tmp_path: Path
) -> None:
    crowd(edit_split, posts, keypoints=[])
    code, out, _ = call("data", "check", posts)
    assert code == 0
    assert "6 frames, 0 trees" in out
    assert "9 run lengths with iscrowd 1 are crowds" in out
    assert "6 frames, 9 trees" in call("data", "check", posts, "--crowds-as-trees")[1]
    arguments = ("train", posts, "--out", tmp_path / "run", "--steps", 1, "--batch", 1)
    code, _, errors = call(*arguments, "--no-keypoints")
    assert code == 2
    assert "no tree that counts (4 of 4 annotations are ignored: 4 by iscrowd)" in errors
    assert "--crowds-as-trees takes run lengths as trees" in errors
