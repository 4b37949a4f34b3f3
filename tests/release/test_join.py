"""Datasets joined into one without copies."""

import json
from pathlib import Path

import numpy as np

from basetree.files.writing import write_image
from perceptree.data import read_dataset
from perceptree.data.stated import labelled_reach_m
from perceptree.simulator.photographs import dataset_credits
from release.join import join


def write_dataset(folder: Path, grey: int, frames: int) -> None:
    """A dataset with one tree a frame, in each split."""
    (folder / "images").mkdir(parents=True)
    owed = [{"kind": "bark", "source": folder.name}, {"kind": "ground"}]
    settings = {"textures": owed, "reach_m": 10.0}
    (folder / "settings.json").write_text(json.dumps(settings))
    for split in ("train", "val", "test"):
        images, trees = [], []
        for number in range(frames):
            name = f"images/{split}{number}.png"
            write_image(folder / name, np.full((36, 64, 3), grey, np.uint8))
            images.append({"id": number, "file_name": name, "width": 64, "height": 36})
            tree = {"bbox": [8, 4, 8, 28], "area": 224, "iscrowd": 0, "category_id": 1}
            trees.append({"id": number + 1, "image_id": number, **tree})
        content = {
            "images": images,
            "annotations": trees,
            "categories": [{"id": 1, "name": "tree"}],
        }
        (folder / f"{split}_RGB.json").write_text(json.dumps(content))


def test_the_frames_of_all_datasets_are_there_with_their_own_trees(tmp_path: Path) -> None:
    parts = [tmp_path / "data" / name for name in ("former", "field")]
    for part, grey, frames in zip(parts, (50, 200), (2, 1), strict=True):
        write_dataset(part, grey, frames)
    out = tmp_path / "data" / "both"
    for _ in range(2):  # a second call changes nothing
        join(parts, out)
    for split in ("train", "val", "test"):
        frames = read_dataset(out, split).frames
        assert [len(frame.trees) for frame in frames] == [1, 1, 1]
    (tmp_path / "data").rename(tmp_path / "moved")
    moved = tmp_path / "moved" / "both"
    assert len(read_dataset(moved, "train").frames) == 3, "links are relative"
    kinds = [each["kind"] for each in dataset_credits(moved / "settings.json")]
    assert kinds == ["bark", "ground", "bark"]
    assert labelled_reach_m([moved]) == 10.0


def test_another_dataset_of_the_same_name_takes_the_place_of_the_first(tmp_path: Path) -> None:
    out = tmp_path / "both"
    for place, grey in (("first", 50), ("second", 200)):
        write_dataset(tmp_path / place / "field", grey, 1)
        join([tmp_path / place / "field"], out)
        (frame,) = read_dataset(out, "train").frames
        assert frame.image_path.resolve().is_relative_to(tmp_path / place)
