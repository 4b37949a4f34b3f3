"""Annotations without area or content are left out and counted; all others are read."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from perceptree.data import read_dataset
from perceptree.data.check import Check
from perceptree.data.tally import LEFT_OUT
from perceptree.errors import DatasetError

Content = dict[str, Any]
Edit = Callable[[Path, str, Callable[[Content], None]], None]
Call = Callable[..., tuple[int, str, str]]
WHOLE = [60, 8, 70, 8, 70, 60, 60, 60]
NOTHING = {"bbox": [0, 0, 0, 0], "segmentation": [], "keypoints": []}


def change_last(edit: Edit, posts: Path, **fields: Any) -> None:
    """Change the last annotation of the train split, number 9."""
    edit(posts, "train", lambda content: content["annotations"][-1].update(fields))


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        (NOTHING, "box_empty"),
        ({"bbox": [60, 57, 0, -24], "segmentation": [[60.2, 57.3, 60.1, 57.6]]}, "box_empty"),
        ({"bbox": [60, 8, -10, 52]}, "box_empty"),
        ({"bbox": [1e9, 8, 1e-9, 52]}, "box_empty"),
        (NOTHING | {"bbox": None}, "no_content"),
        ({"bbox": [], "segmentation": None, "keypoints": None}, "no_content"),
        ({"segmentation": [[60, 8, 70, 60]]}, "mask_short"),
        ({"segmentation": [60, 8, 70, 60]}, "mask_short"),
        ({"segmentation": [[60, 8]]}, "mask_short"),
        ({"segmentation": [[]]}, "mask_short"),
        ({"segmentation": [[60, 8, 60, 9, 60, 12]]}, "mask_short"),
    ],
)
def test_an_annotation_without_area_or_content_is_left_out(
    posts: Path, edit_split: Edit, fields: dict[str, Any], reason: str
) -> None:
    change_last(edit_split, posts, **fields)
    dataset = read_dataset(posts, "train")
    numbers = [tree.number for frame in dataset.frames for tree in frame.trees]
    assert numbers == list(range(1, 9))
    assert dataset.tally.left_out == [(reason, 9)]
    assert dataset.notes[0] == f"left out: 1 {LEFT_OUT[reason]}, the first of annotation 9"
    (finding,) = Check(posts).run().findings
    assert (finding.kind, finding.first) == (reason, ("train annotation 9",))


@pytest.mark.parametrize("part", [[10, 10, 12, 14], [10, 10], [], [5, 5, 5, 5, 5, 5]])
def test_a_part_without_area_is_left_out_and_the_others_stay(
    posts: Path, edit_split: Edit, part: list[int]
) -> None:
    change_last(edit_split, posts, segmentation=[part, WHOLE, part])
    dataset = read_dataset(posts, "train")
    frame = dataset.frames[-1]
    assert frame.mask(frame.trees[-1]).sum() == 10 * 52
    assert dataset.tally.left_out == [("polygon_short", 9)] * 2


def test_a_box_is_kept_where_no_tree_has_a_mask(posts: Path, edit_split: Edit) -> None:
    def change(content: Content) -> None:
        for annotation in content["annotations"]:
            annotation["segmentation"] = []
        content["annotations"][-1]["segmentation"] = [[60, 8, 70, 60]]

    edit_split(posts, "train", change)
    dataset = read_dataset(posts, "train")
    assert sum(len(frame.trees) for frame in dataset.frames) == 9
    assert not dataset.has_masks


def test_a_missing_box_is_that_of_the_polygons(posts: Path, edit_split: Edit) -> None:
    change_last(edit_split, posts, segmentation=[WHOLE, [50, 20, 55, 20, 55, 30]], bbox=None)
    tree = read_dataset(posts, "train").frames[-1].trees[-1]
    assert tree.box_px.tolist() == [50, 8, 70, 60]


def test_other_categories_are_not_counted(posts: Path, edit_split: Edit) -> None:
    def change(content: Content) -> None:
        content["categories"].append({"id": 2, "name": "stump"})
        content["annotations"][-1].update(NOTHING, category_id=2)

    edit_split(posts, "train", change)
    assert read_dataset(posts, "train").tally.left_out == []


def test_broken_entries_refuse_a_training_unless_they_are_skipped(
    posts: Path, edit_split: Edit, call: Call, tmp_path: Path
) -> None:
    change_last(edit_split, posts, bbox=[1, 2])
    edit_split(posts, "val", lambda content: content["annotations"][0].update(bbox="here"))
    arguments = ("train", posts, "--out", tmp_path / "run", "--steps", 1, "--batch", 1)
    size = ("--height", 64, "--width", 96, "--workers", 0)
    code, _, errors = call(*arguments, *size)
    assert code == 2
    assert "bbox of annotation 1 is 'here', expected 4 finite numbers; --skip-broken" in errors
    code, _, errors = call(*arguments, *size, "--skip-broken")
    assert code == 0
    assert "left out 1 broken entries: bbox of annotation 9 is [1, 2]" in errors


@pytest.mark.parametrize(
    ("field", "values"),
    [("bbox", [1, 2, 1e300, 1e300]), ("keypoints", [1e12, 2, 2] + [5, 5, 2] * 4)],
)
def test_numbers_that_are_no_pixels_are_a_broken_entry(
    posts: Path, edit_split: Edit, field: str, values: list[float]
) -> None:
    change_last(edit_split, posts, **{field: values})
    with pytest.raises(DatasetError, match=f"{field} of annotation 9 .* pixels, up to 1000000000"):
        read_dataset(posts, "train")
