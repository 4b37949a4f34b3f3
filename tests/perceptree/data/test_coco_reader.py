"""Reading COCO files: labels in continuous px, and errors in one line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from perceptree.data import read_split
from perceptree.data.frames import read_frame
from perceptree.errors import DatasetError

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]


def test_labels_are_converted_to_continuous_px(posts: Path) -> None:
    frame = read_split(posts, "train")[0]
    content = json.loads((posts / "train_RGB.json").read_text())
    on_disk = content["annotations"][0]
    tree = frame.trees[0]
    x, y, width, height = on_disk["bbox"]
    assert tree.box_px.tolist() == [x, y, x + width, y + height]
    # On disk the left edge is half a pixel left of the first post pixel's centre.
    assert tree.keypoints[1].tolist() == [x, 55.0, 2]
    assert tree.keypoints[2].tolist() == [x + width, 55.0, 2]
    assert tree.keypoints[4].tolist() == [0, 0, 0]
    assert tree.truth["diameter_m"] == 0.3
    assert tree.species == "post"
    assert frame.extra["up_camera"] == [0.0, -1.0, 0.0]
    assert frame.depth_path == posts / "depth/000000.png"


def test_run_lengths_and_polygons_give_the_same_mask(posts: Path, edit_split: Edit) -> None:
    expected = [frame.mask(frame.trees[0]) for frame in read_split(posts, "train")]

    def as_polygons(content: dict[str, Any]) -> None:
        for annotation in content["annotations"]:
            x, y, w, h = annotation["bbox"]
            annotation["segmentation"] = [[x, y, x + w, y, x + w, y + h, x, y + h]]

    edit_split(posts, "train", as_polygons)
    for frame, mask in zip(read_split(posts, "train"), expected, strict=True):
        x0, y0, x1, y1 = frame.trees[0].box_px.astype(int)
        drawn = frame.mask(frame.trees[0])
        assert mask.sum() == (x1 - x0) * (y1 - y0)
        assert mask[y0:y1, x0:x1].all()
        assert (drawn == mask).all()


def test_uncompressed_and_compressed_run_lengths_are_equal(posts: Path, edit_split: Edit) -> None:
    frame = read_split(posts, "test")[0]
    mask = frame.mask(frame.trees[0])
    flat = mask.ravel(order="F").astype(int)
    ends = np.flatnonzero(np.diff(flat)) + 1
    counts = np.diff([0, *ends.tolist(), flat.size]).tolist()
    edit_split(posts, "test", lambda c: c["annotations"][0]["segmentation"].update(counts=counts))
    again = read_split(posts, "test")[0]
    assert (again.mask(again.trees[0]) == mask).all()


def _set(row: str, index: int, field: str, value: Any) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        content[row][index][field] = value

    return change


def _drop(row: str, index: int, field: str) -> Callable[[dict[str, Any]], None]:
    def change(content: dict[str, Any]) -> None:
        del content[row][index][field]

    return change


FAULTS = {
    "box_of_two": (_set("annotations", 0, "bbox", [1, 2]), "bbox of annotation 1 is [1, 2]"),
    "box_text": (_set("annotations", 0, "bbox", "here"), "bbox of annotation 1 is 'here'"),
    "box_nan": (_set("annotations", 0, "bbox", [1, 2, float("nan"), 4]), "4 finite numbers"),
    "box_missing": (_drop("annotations", 0, "bbox"), "bbox of annotation 1 is missing"),
    "keypoints": (_set("annotations", 0, "keypoints", [1, 2, 2]), "expected 15 finite numbers"),
    "flag": (_set("annotations", 0, "keypoints", [7] * 15), "flags of 0, 1 or 2"),
    "owner": (_set("annotations", 0, "image_id", 999), "image_id of annotation 1 is 999"),
    "size": (
        _set("annotations", 0, "segmentation", {"size": [9, 9], "counts": "a"}),
        "segmentation of annotation 1",
    ),
    "no_mask": (_drop("annotations", 0, "segmentation"), "segmentation of annotation 1 is missing"),
    "polygon": (_set("annotations", 0, "segmentation", [[1, 2, 3]]), "polygons"),
    "polygon_far": (
        _set("annotations", 0, "segmentation", [[10**50, 0, 3, 0, 3, 4]]),
        "expected polygons whose boundaries have at most",
    ),
    "polygon_long": (
        _set("annotations", 0, "segmentation", [[0, 0, 60, 60] * 9999]),
        "expected polygons whose boundaries have at most",
    ),
    "truth": (_set("annotations", 0, "diameter_m", "thick"), "diameter_m of annotation 1"),
    "width": (_set("images", 0, "width", 0), "width of image 0 is 0"),
    "name": (_drop("images", 0, "file_name"), "file_name of image 0 is missing"),
    "depth8": (_set("images", 0, "depth8_file", 5), "depth8_file of image 0 is 5"),
    "twice": (_set("images", 1, "id", 0), "have the id"),
    "no_images": (lambda c: c["images"].clear(), "holds no images"),
    "no_list": (lambda c: c.update(annotations=3), "a list of annotations"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_wrong_entry_is_one_line_with_file_value_and_expectation(
    posts: Path, edit_split: Edit, fault: str
) -> None:
    change, expected = FAULTS[fault]
    edit_split(posts, "train", change)
    with pytest.raises(DatasetError) as caught:
        read_split(posts, "train")
    line = str(caught.value)
    assert line.startswith(f"{posts / 'train_RGB.json'}: ")
    assert expected in line
    assert "expected" in line
    assert "\n" not in line


@pytest.mark.parametrize(
    "name", ["../secret.png", "images/../../secret.png", "/etc/passwd", "a\0b.png"]
)
@pytest.mark.parametrize("field", ["file_name", "depth_file", "depth8_file"])
def test_paths_out_of_the_data_sets_folder_are_refused(
    name: str, field: str, posts: Path, edit_split: Edit
) -> None:
    edit_split(posts, "train", _set("images", 1, field, name))
    with pytest.raises(DatasetError, match=rf"{field} of image 1 is .*in the dataset's folder"):
        read_split(posts, "train")


def test_paths_with_dots_inside_the_folder_are_read(posts: Path, edit_split: Edit) -> None:
    def with_dots(content: dict[str, Any]) -> None:
        for image in content["images"]:
            image["file_name"] = f"here/../{image['file_name']}"

    expected = [frame.image_path.name for frame in read_split(posts, "train")]
    edit_split(posts, "train", with_dots)
    assert [frame.image_path.name for frame in read_split(posts, "train")] == expected


def test_a_name_longer_than_the_system_allows_names_a_missing_picture(
    posts: Path, edit_split: Edit
) -> None:
    edit_split(posts, "train", _set("images", 0, "file_name", "n" * 5000))
    frame = read_split(posts, "train")[0]
    with pytest.raises(DatasetError, match=r"nnn: "):
        read_frame(frame, "rgb")


@pytest.mark.parametrize("width", [10**9, int("9" * 400)])
def test_sizes_that_no_picture_has_are_refused(width: int, posts: Path, edit_split: Edit) -> None:
    edit_split(posts, "train", _set("images", 0, "width", width))
    with pytest.raises(DatasetError, match="expected a picture of at most 200000000 pixels"):
        read_split(posts, "train")


def test_missing_and_unreadable_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"train_RGB\.json: no such file, expected a dataset"):
        read_split(tmp_path, "train")
    (tmp_path / "train_RGB.json").write_text("{")
    with pytest.raises(DatasetError, match=r"train_RGB\.json: not readable JSON"):
        read_split(tmp_path, "train")
    (tmp_path / "train_RGB.json").write_text("[1]")
    with pytest.raises(DatasetError, match="expected a COCO file"):
        read_split(tmp_path, "train")


@pytest.mark.parametrize("counts", ["", "%%%", [5, 5], [1, -1, 9]])
def test_run_lengths_that_do_not_fill_the_frame_are_rejected(
    posts: Path, edit_split: Edit, counts: Any
) -> None:
    edit_split(posts, "test", lambda c: c["annotations"][0]["segmentation"].update(counts=counts))
    frame = read_split(posts, "test")[0]
    with pytest.raises(DatasetError, match="segmentation of annotation 1 is broken"):
        frame.mask(frame.trees[0])


def test_the_chunk_size_makes_no_difference(posts: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = read_split(posts, "train")
    monkeypatch.setattr("perceptree.data.parsing._CHUNK", 4)
    for frame, part in zip(whole, read_split(posts, "train"), strict=True):
        assert [tree.number for tree in frame.trees] == [tree.number for tree in part.trees]
        for tree, same in zip(frame.trees, part.trees, strict=True):
            assert (tree.box_px == same.box_px).all()
            assert (tree.keypoints == same.keypoints).all()
