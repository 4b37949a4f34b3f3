"""Which frames of a dataset an export compares and calibrates on."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.export.frames import find_frames
from edgetree.export.verification import read_verification_frames
from perceptree.models import make_spec

IMAGE = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)


def write_labels(path: Path, *names: str) -> None:
    """A COCO file of pictures without trees, and the pictures."""
    images = [
        {"id": number, "file_name": name, "width": 64, "height": 48}
        for number, name in enumerate(names)
    ]
    content = {
        "images": images,
        "annotations": [],
        "categories": [{"id": 1, "name": "tree"}],
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content))


def write_image(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), IMAGE)
    return path


@pytest.mark.parametrize("test_split", [True, False])
def test_pictures_in_the_folders_of_a_labelling_tool_are_found(
    tmp_path: Path, test_split: bool
) -> None:
    there = [write_image(tmp_path / "images" / "default" / f"{name}.jpg") for name in "ab"]
    write_labels(tmp_path / "annotations" / "instances_default.json", "a.jpg", "b.jpg")
    assert find_frames(tmp_path, "rgb", 20, test_split=test_split) == there


def test_of_other_layouts_the_test_split_is_compared_on(tmp_path: Path) -> None:
    for split in ("train", "valid", "test"):
        write_image(tmp_path / split / f"{split}.jpg")
        write_labels(tmp_path / split / "_annotations.coco.json", f"{split}.jpg")
    compared = find_frames(tmp_path, "rgb", 20, test_split=True)
    assert [path.name for path in compared] == ["test.jpg"]
    assert len(find_frames(tmp_path, "rgb", 20)) == 3


def test_of_splits_that_share_a_folder_of_pictures_the_test_split_is_compared_on(
    tmp_path: Path,
) -> None:
    for split in ("train", "test"):
        write_image(tmp_path / "images" / f"{split}.jpg")
        write_labels(tmp_path / "annotations" / f"instances_{split}.json", f"{split}.jpg")
    compared = find_frames(tmp_path, "rgb", 20, test_split=True)
    assert [path.name for path in compared] == ["test.jpg"]
    assert len(find_frames(tmp_path, "rgb", 20)) == 2


def test_without_a_test_split_the_validation_split_is_compared_on(tmp_path: Path) -> None:
    for split in ("train", "val"):
        write_image(tmp_path / "images" / f"{split}.jpg")
        write_labels(tmp_path / f"{split}_RGB.json", f"{split}.jpg")
    compared = find_frames(tmp_path, "rgb", 20, test_split=True)
    assert [path.name for path in compared] == ["val.jpg"]


def test_pictures_of_one_name_in_two_folders_are_all_compared(tmp_path: Path) -> None:
    for folder in ("one", "two"):
        write_image(tmp_path / "images" / folder / "a.jpg")
    write_labels(tmp_path / "annotations" / "instances_default.json", "one/a.jpg", "two/a.jpg")
    spec = make_spec("edge-n", modality="rgb", height=96, width=160)
    assert len(read_verification_frames(tmp_path, spec).images) == 2


def test_a_label_file_stands_for_its_pictures(tmp_path: Path) -> None:
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        write_image(tmp_path / name)
    write_labels(tmp_path / "labels.json", "a.jpg", "c.jpg")
    found = find_frames(tmp_path / "labels.json", "rgb", 20)
    assert [path.name for path in found] == ["a.jpg", "c.jpg"]


def test_a_folder_without_frames_or_labels_is_told(tmp_path: Path) -> None:
    (tmp_path / "images" / "default").mkdir(parents=True)
    with pytest.raises(InputError, match=r"has no rgb frames: expected \.jpg"):
        find_frames(tmp_path, "rgb", 20)
