"""Dataset layouts, recreated in small from their descriptions."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perceptree.data import SPLITS, read_dataset, read_split
from perceptree.data.layouts import find_splits
from perceptree.errors import DatasetError

Content = dict[str, Any]
OURS = ("depth_file", "depth8_file", "depth_encoding", "camera", "up_camera", "scene")


def _content(posts: Path, split: str) -> Content:
    content: Content = json.loads((posts / f"{split}_RGB.json").read_text())
    for image in content["images"]:
        for field in OURS:
            image.pop(field, None)
    return content


def _move(posts: Path, content: Content, folder: Path, name: Callable[[int], str]) -> None:
    """Move a file's images to a folder under new names."""
    folder.mkdir(parents=True, exist_ok=True)
    for image in content["images"]:
        shutil.copy(posts / image["file_name"], folder / name(image["id"]))
        image["file_name"] = name(image["id"])


def _write(path: Path, content: Content) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def _published(posts: Path, out: Path) -> Path:
    """SynthTree43k as PercepTreeV1 describes it: images and label files in one folder."""
    for split in SPLITS:
        content = _content(posts, split)
        _move(posts, content, out, lambda number: f"image_{number:05d}_RGB.png")
        content["categories"] = [
            {"id": 1, "name": "tree", "keypoints": ["kpCP", "kpL", "kpR", "AX1", "AX2"]}
        ]
        _write(out / f"{split}_RGB.json", content)
        for annotation in content["annotations"]:
            annotation["bbox"][1], annotation["bbox"][3] = 0, 60
        _write(out / f"{split}_RGB_entire_tree.json", content)
    return out


def _agrees(directory: Path, posts: Path, split: str, **chosen: Any) -> None:
    found, expected = read_dataset(directory, split, **chosen), read_dataset(posts, split)
    assert len(found.frames) == len(expected.frames) > 0
    for frame, like in zip(found.frames, expected.frames, strict=True):
        assert np.array_equal(*(cv2.imread(str(f.image_path)) for f in (frame, like)))
        assert len(frame.trees) == len(like.trees)
        for tree, other in zip(frame.trees, like.trees, strict=True):
            assert (tree.keypoints == other.keypoints).all()
            assert (frame.mask(tree) == like.mask(other)).all()


def test_synthtree43k_as_published(posts: Path, tmp_path: Path) -> None:
    directory = _published(posts, tmp_path / "SynthTree43k")
    for split in SPLITS:
        _agrees(directory, posts, split)
        assert read_split(directory, split)[0].trees[0].box_px[1] == 8
    dataset = read_dataset(directory, "train")
    assert (dataset.has_masks, dataset.has_keypoints, dataset.has_depth) == (True, True, False)
    assert dataset.notes == ()


def test_synthtree43ks_labels_of_entire_trees_are_chosen(posts: Path, tmp_path: Path) -> None:
    directory = _published(posts, tmp_path / "SynthTree43k")
    dataset = read_dataset(directory, "val", entire_tree=True)
    assert dataset.labels.path.name == "val_RGB_entire_tree.json"
    assert dataset.frames[0].trees[0].box_px[1] == 0
    for split in SPLITS:
        (directory / f"{split}_RGB.json").unlink()
    with pytest.raises(DatasetError, match="use --entire-tree for labels of entire trees"):
        read_dataset(directory, "val")


@pytest.mark.parametrize(
    "place",
    [
        "SynthTree43k/depth/image_{:05d}_RGB.png",
        "SynthTree43k/Depth/image_{:05d}_depth.png",
        "SynthTree43k/image_{:05d}_Depth.png",
        "SynthTree43k_depth/image_{:05d}_RGB.png",
    ],
)
def test_depth_pictures_are_found_by_their_names(posts: Path, tmp_path: Path, place: str) -> None:
    directory = _published(posts, tmp_path / "SynthTree43k")
    for split in SPLITS:
        for frame in read_split(posts, split):
            path = tmp_path / place.format(frame.image_id)
            path.parent.mkdir(exist_ok=True)
            assert frame.depth8_path is not None
            shutil.copy(frame.depth8_path, path)
    dataset = read_dataset(directory, "train")
    assert dataset.has_depth
    assert dataset.frames[3].depth8_path == tmp_path / place.format(3)
    assert "their depth encoding is unknown" in " ".join(dataset.notes)


def test_depth_that_is_not_8_bit_is_left_out_with_a_note(posts: Path, tmp_path: Path) -> None:
    directory = _published(posts, tmp_path / "SynthTree43k")
    (directory / "depth").mkdir()
    for frame in read_split(posts, "train"):
        shutil.copy(frame.depth_path or "", directory / f"depth/image_{frame.image_id:05d}_RGB.png")
    dataset = read_dataset(directory, "train")
    assert not dataset.has_depth
    assert "is not an 8-bit single-channel image" in " ".join(dataset.notes)


def _folds(posts: Path, out: Path, name: str) -> Path:
    """CanaTree100: train, val and test of five folds; each fold has its own number of frames."""
    for fold in range(1, 6):
        for split in SPLITS:
            content = _content(posts, split)
            _move(posts, content, out, lambda number: f"{number:03d}.png")
            if split == "train":
                content["images"] = content["images"][:fold]
                kept = {image["id"] for image in content["images"]}
                content["annotations"] = [
                    a for a in content["annotations"] if a["image_id"] in kept
                ]
            _write(out / name.format(split=split, fold=fold), content)
    return out


FOLDS = [
    "annotations/trees_{split}{fold}.json",
    "annotations/{split}_RGB_fold_0{fold}.json",
    "fold_0{fold}/{split}_RGB.json",
    "fold{fold}/annotations/trees_{split}.json",
]


@pytest.mark.parametrize("name", FOLDS)
def test_canatree100s_folds_are_listed_and_chosen(posts: Path, tmp_path: Path, name: str) -> None:
    directory = _folds(posts, tmp_path / "CanaTree100", name)
    with pytest.raises(DatasetError, match=r"folds 1, 2, 3, 4, 5, expected one: --fold"):
        read_dataset(directory, "train")
    for fold in range(1, 6):
        dataset = read_dataset(directory, "train", fold=fold)
        assert len(dataset.frames) == fold
        assert all(frame.image_path.is_file() for frame in dataset.frames)
    _agrees(directory, posts, "val", fold=2)
    with pytest.raises(DatasetError, match="expected labels of val in fold 6"):
        read_dataset(directory, "val", fold=6)
    assert [labels.split for labels in find_splits(directory, fold=3)] == list(SPLITS)


def test_labels_in_an_annotations_folder(posts: Path, tmp_path: Path) -> None:
    for split in SPLITS:
        content = _content(posts, split)
        _move(posts, content, tmp_path / "set", lambda number: f"{number}.png")
        _write(tmp_path / f"set/annotations/trees_{split}.json", content)
    _agrees(tmp_path / "set", posts, "test")


@pytest.mark.parametrize(
    "folder", ["{split}2017", "images/{split}2017", "images/{split}", "images"]
)
def test_coco_with_a_year(posts: Path, tmp_path: Path, folder: str) -> None:
    for split in SPLITS:
        content = _content(posts, split)
        _move(posts, content, tmp_path / "set" / folder.format(split=split), "{}.png".format)
        _write(tmp_path / f"set/annotations/instances_{split}2017.json", content)
        _write(tmp_path / f"set/annotations/captions_{split}2017.json", {"images": []})
    for split in SPLITS:
        _agrees(tmp_path / "set", posts, split)
        assert read_dataset(tmp_path / "set", split).labels.fold is None


def test_a_copy_in_a_subfolder_is_ignored(posts: Path) -> None:
    shutil.copytree(posts, posts / "annotations")
    shutil.copytree(posts / "annotations", posts / "backup")
    assert read_dataset(posts, "val").labels.path == posts / "val_RGB.json"
    (posts / "val_RGB.json").unlink()
    assert read_dataset(posts, "val").labels.path == posts / "annotations/val_RGB.json"


def test_images_are_found_despite_folders_of_another_machine(
    posts: Path, edit_split: Callable[[Path, str, Callable[[Content], None]], None]
) -> None:
    def change(content: Content) -> None:
        for image in content["images"]:
            image["file_name"] = "D:\\forest\\" + image["file_name"].replace("/", "\\")

    edit_split(posts, "val", change)
    assert all(frame.image_path.is_file() for frame in read_split(posts, "val"))


def test_splits_with_equal_file_names_use_their_own_folders(posts: Path, tmp_path: Path) -> None:
    for split in SPLITS:
        content = _content(posts, split)
        first = content["images"][0]["id"]
        _move(
            posts,
            content,
            tmp_path / "set" / split,
            lambda number, first=first: f"{number - first}.png",
        )
        _write(tmp_path / "set" / f"annotations/instances_{split}.json", content)
    for split in SPLITS:
        _agrees(tmp_path / "set", posts, split)


def test_roboflow(posts: Path, tmp_path: Path) -> None:
    for split, folder in (("train", "train"), ("val", "valid"), ("test", "test")):
        content = _content(posts, split)
        _move(posts, content, tmp_path / "set" / folder, lambda number: f"{number}.png")
        content["categories"] = [
            {"id": 0, "name": "survey-q7", "supercategory": "none"},
            {"id": 1, "name": "class-1", "supercategory": "survey-q7"},
        ]
        _write(tmp_path / "set" / folder / "_annotations.coco.json", content)
    for split in SPLITS:
        _agrees(tmp_path / "set", posts, split)


def test_a_single_label_file_has_the_split_in_its_name(posts: Path) -> None:
    assert len(read_split(posts / "val_RGB.json", "val")) == 3
    with pytest.raises(
        DatasetError, match="is a label file of split val, expected one of split train or a folder"
    ):
        read_split(posts / "val_RGB.json", "train")
    (posts / "test_RGB.json").rename(posts / "stand 7.json")
    assert len(read_split(posts / "stand 7.json", "test")) == 2


def test_other_json_files_are_not_label_files(posts: Path) -> None:
    for name in ("settings.json", "test_results.json", "scenes/train.json.part", "depth/val.json"):
        (posts / name).parent.mkdir(exist_ok=True)
        (posts / name).write_text("{}")
    assert [labels.path.name for labels in find_splits(posts)] == [
        f"{split}_RGB.json" for split in SPLITS
    ]


def test_errors_list_the_label_files_found(posts: Path) -> None:
    (posts / "test_RGB.json").unlink()
    with pytest.raises(DatasetError) as missing:
        read_split(posts, "test")
    assert "expected labels of test, like test_RGB.json; found train_RGB.json, val" in str(
        missing.value
    )
    for name in ("instances_test.json", "person_keypoints_test.json"):
        shutil.copy(posts / "val_RGB.json", posts / name)
    with pytest.raises(DatasetError, match="several label files for test: instances_test"):
        read_split(posts, "test")
