"""Ignored annotations: which they are, what is said of them, and how samples carry them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from basetree.errors import SettingsError
from perceptree.data import FrameStore, read_dataset, read_split
from perceptree.data.cache import open_cache
from perceptree.data.grading import ungraded
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec, make_spec

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]
SPEC: ModelSpec = make_spec("edge-n", "depth", 64, 96)


def change_annotations(edit_split: Edit, posts: Path, **by_number: dict[str, Any]) -> None:
    """Change fields of annotations of the train split, given as ``_1={...}``."""

    def change(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            annotation.update(by_number.get(f"_{annotation['id']}", {}))

    edit_split(posts, "train", change)


def ignored_numbers(posts: Path, certain_m: float | None = None) -> list[int]:
    frames = read_dataset(posts, "train", certain_m=certain_m).frames
    return [tree.number for frame in frames for tree in frame.trees if tree.ignored]


@pytest.mark.parametrize("value", [1, True])
@pytest.mark.parametrize("field", ["iscrowd", "ignore"])
def test_marked_annotations_are_ignored_and_counted_aloud(
    posts: Path, edit_split: Edit, field: str, value: Any
) -> None:
    marked = {field: value, "keypoints": []}
    change_annotations(edit_split, posts, _2=marked, _5=marked, _6={field: False})
    assert ignored_numbers(posts) == [2, 5]
    notes = read_dataset(posts, "train").notes
    assert f"2 of 9 annotations are ignored: 2 by {field}" in notes
    assert not any("ignored" in note for note in read_dataset(posts, "val").notes)


@pytest.mark.parametrize("value", [2, -1, 0.0, 1.0, "1", None, [1]])
@pytest.mark.parametrize("field", ["iscrowd", "ignore"])
def test_other_marks_are_refused(posts: Path, edit_split: Edit, field: str, value: Any) -> None:
    change_annotations(edit_split, posts, _4={field: value})
    with pytest.raises(DatasetError, match=rf"train_RGB.json: {field} of annotation 4 is .*, expe"):
        read_dataset(posts, "train")


def test_a_marked_annotation_needs_no_mask(posts: Path, edit_split: Edit) -> None:
    change_annotations(edit_split, posts, _2={"ignore": 1, "segmentation": None})
    assert read_dataset(posts, "train").has_masks
    change_annotations(edit_split, posts, _2={"ignore": 0})
    with pytest.raises(DatasetError, match="segmentation of annotation 2"):
        read_dataset(posts, "train")


def test_keypoints_of_ignored_annotations_alone_do_not_count(posts: Path, edit_split: Edit) -> None:
    bare = {f"_{number}": {"keypoints": []} for number in range(2, 10)}
    change_annotations(edit_split, posts, **bare)
    assert read_dataset(posts, "train").has_keypoints
    change_annotations(edit_split, posts, _1={"ignore": 1})
    assert not read_dataset(posts, "train").has_keypoints


def test_trees_beyond_the_certain_distance_are_ignored(posts: Path, edit_split: Edit) -> None:
    far, crowd = {"distance_m": 8.51}, {"iscrowd": 1, "keypoints": []}
    change_annotations(
        edit_split, posts, _1={"distance_m": 8.5}, _2=far, _3=far | {"ignore": 1}, _4=crowd
    )
    assert ignored_numbers(posts) == [3, 4]
    assert ignored_numbers(posts, 8.5) == [2, 3, 4]
    assert ignored_numbers(posts, 9.0) == [3, 4]
    dataset = read_dataset(posts, "train", certain_m=8.5)
    text = "3 of 9 annotations are ignored: 1 by iscrowd, 1 by ignore, 1 beyond 8.5 m"
    assert text in dataset.notes
    counted = [tree.number for f in ungraded(dataset.frames) for tree in f.trees if tree.ignored]
    assert counted == [3, 4]
    none = read_dataset(posts, "val", certain_m=8.5).notes
    assert "5 of 5 annotations" not in "".join(none)
    assert any(note.endswith("annotations are ignored: none") for note in none)


def test_trees_without_a_distance_count(posts: Path, edit_split: Edit) -> None:
    def drop(content: dict[str, Any]) -> None:
        del content["annotations"][0]["distance_m"]

    edit_split(posts, "train", drop)
    assert ignored_numbers(posts, 1.0) == list(range(2, 10))


def test_a_certain_distance_needs_distances(posts: Path, edit_split: Edit) -> None:
    def drop(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            del annotation["distance_m"]

    edit_split(posts, "train", drop)
    with pytest.raises(DatasetError, match=r"train_RGB.json: no tree has a distance_m, .* 8.5 m$"):
        read_dataset(posts, "train", certain_m=8.5)


@pytest.mark.parametrize("certain_m", [0.0, -1.0, float("nan"), float("inf")])
def test_a_certain_distance_that_is_none_is_refused(posts: Path, certain_m: float) -> None:
    with pytest.raises(SettingsError, match=r"certain distance is .* m: expected more than 0"):
        read_dataset(posts, "train", certain_m=certain_m)


def test_a_sample_has_ignored_trees_as_boxes_alone(posts: Path, edit_split: Edit) -> None:
    change_annotations(edit_split, posts, _2={"ignore": 1}, _3={"iscrowd": 1, "keypoints": []})
    frames = read_split(posts, "train")
    store = FrameStore(frames, SPEC)
    assert store.trees == 7
    # 128x72 px fit into 96x64 px with a factor of 0.75; frame 1 has the trees 2 and 3.
    sample, boxes = store[1], np.array([tree.box_px for tree in frames[1].trees])
    assert sample.ignored == pytest.approx(0.75 * boxes)
    assert (sample.boxes.shape, sample.masks.shape) == ((0, 4), (0, 64, 96))
    assert sample.targets().ignored.numpy() == pytest.approx(0.75 * boxes)
    assert store[0].ignored.shape == (0, 4)


def test_the_cache_keeps_ignored_boxes(posts: Path, edit_split: Edit, tmp_path: Path) -> None:
    change_annotations(edit_split, posts, _2={"ignore": 1}, _6={"ignore": 1})
    frames = read_split(posts, "train")
    cache, store = open_cache(frames, SPEC, tmp_path / "cache"), FrameStore(frames, SPEC)
    for number in range(len(store)):
        np.testing.assert_allclose(cache[number].ignored, store[number].ignored, atol=1e-4)
        np.testing.assert_allclose(cache[number].boxes, store[number].boxes, atol=1e-4)
    assert [len(cache[number].ignored) for number in range(6)] == [0, 1, 0, 1, 0, 0]
    assert cache.trees == 7


def test_a_cache_is_made_again_when_a_tree_becomes_ignored(posts: Path, tmp_path: Path) -> None:
    frames = read_split(posts, "train")
    first = open_cache(frames, SPEC, tmp_path / "cache")
    crowded = [replace(frames[0], trees=(replace(frames[0].trees[0], far=True),)), *frames[1:]]
    second = open_cache(crowded, SPEC, tmp_path / "cache")
    assert (first.trees, second.trees) == (9, 8)
    assert len(second[0].ignored) == 1


def test_a_cache_of_the_older_layout_is_made_again(posts: Path, tmp_path: Path) -> None:
    frames, folder = read_split(posts, "train"), tmp_path / "cache"
    first = open_cache(frames, SPEC, folder)
    record = json.loads((folder / "cache.json").read_text())
    del record["version"]  # as it was
    (folder / "cache.json").write_text(json.dumps(record))
    for name in ("ignored", "ignored_starts"):
        (folder / f"{name}.npy").unlink()
    again = open_cache(frames, SPEC, folder)
    assert again.key == first.key
    assert again[1].ignored.shape == (0, 4)
