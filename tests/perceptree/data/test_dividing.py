"""Dividing labelled pictures into splits, and a training on labels without a split."""

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from schema_check import check_schema

from basetree.errors import SettingsError
from perceptree.data import FrameRecord, read_dataset
from perceptree.data.check import Check
from perceptree.data.dividing import divide
from perceptree.errors import DatasetError

Call = Callable[..., tuple[int, str, str]]
SHARES = {"val": 0.2, "test": 0.2}


def frame(number: int, path: Path, scene: int | None = None) -> FrameRecord:
    extra = {} if scene is None else {"scene": {"seed": scene}}
    return FrameRecord(number, path, None, None, 64, 48, extra, ())


@pytest.fixture
def pictures(tmp_path: Path) -> list[Path]:
    """Forty different pictures of four folders, each tenth of one series of names."""
    paths = [tmp_path / f"plot{number // 10}" / f"drive_{number:03d}.jpg" for number in range(40)]
    for number, path in enumerate(paths):
        path.parent.mkdir(exist_ok=True)
        noise = np.random.default_rng(number).integers(0, 255, (6, 8, 3), np.uint8)
        cv2.imwrite(str(path), cv2.resize(noise, (64, 48)))
    return paths


def test_shares_and_seed(pictures: list[Path]) -> None:
    frames = [frame(number, path) for number, path in enumerate(pictures)]
    splits = divide(frames, SHARES)
    assert {split: len(found) for split, found in splits.items()} == {
        "train": 24,
        "val": 8,
        "test": 8,
    }
    ids = [one.image_id for found in splits.values() for one in found]
    assert sorted(ids) == list(range(40))
    again, other = divide(frames, SHARES), divide(frames, SHARES, seed=2)
    assert [f.image_id for f in again["val"]] == [f.image_id for f in splits["val"]]
    assert [f.image_id for f in other["val"]] != [f.image_id for f in splits["val"]]
    assert set(divide(frames, {"val": 0.2, "test": 0.0})) == {"train", "val"}


@pytest.mark.parametrize("by", ["folder", "name"])
def test_places_stay_together(pictures: list[Path], by: str) -> None:
    frames = [frame(number, path) for number, path in enumerate(pictures)]
    splits = divide(frames, SHARES, by)
    folders = [{one.image_path.parent for one in found} for found in splits.values()]
    assert sum(map(len, folders)) == 4
    assert all(folders)


def test_scenes_and_pictures_that_look_alike_stay_together(pictures: list[Path]) -> None:
    frames = [frame(number, path, number // 5) for number, path in enumerate(pictures)]
    for found in divide(frames, SHARES).values():
        scenes = {one.image_id // 5 for one in found}
        assert len(found) == 5 * len(scenes)
    for number, path in enumerate(pictures):  # now pairs of pictures, one of them darker
        image = cv2.imread(str(pictures[number - number % 2]))
        cv2.imwrite(str(path), np.asarray(image * (0.8 if number % 2 else 1)))
    alike = divide([frame(number, path) for number, path in enumerate(pictures)], SHARES)
    for found in alike.values():
        assert len(found) == 2 * len({one.image_id // 2 for one in found})


def test_wrong_shares_and_too_few_groups(pictures: list[Path]) -> None:
    frames = [frame(number, path) for number, path in enumerate(pictures[:10])]
    with pytest.raises(DatasetError, match=r"10 pictures form 1 group .* at least 3"):
        divide(frames, SHARES, "folder")
    for shares in ({"val": -0.1}, {"val": 0.6, "test": 0.6}, {"val": 0.0}, {"val": float("nan")}):
        with pytest.raises(SettingsError):
            divide(frames, shares)
    with pytest.raises(SettingsError, match="--by is 'tree'"):
        divide(frames, SHARES, "tree")
    with pytest.raises(SettingsError, match="--seed is -1: expected at least 0"):
        divide(frames, SHARES, seed=-1)


@pytest.fixture
def export(write_dataset: Callable[..., Path]) -> Path:
    """One label file without a split, and its pictures."""
    folder = write_dataset(train=8, val=1, test=1)
    for split in ("val", "test"):
        (folder / f"{split}_RGB.json").unlink()
    (folder / "train_RGB.json").rename(folder / "instances_default.json")
    return folder


def test_the_command_writes_a_dataset_that_trains(export: Path, call: Call, tmp_path: Path) -> None:
    out = tmp_path / "trees"
    code, printed, errors = call(
        "data", "split", export, "--out", out, "--val", 0.25, "--test", 0.25
    )
    assert code == 0, errors
    assert "train" in printed
    check_schema(json.loads((out / "train_RGB.json").read_text()), "perceptree.labels")
    printed = call("data", "convert", out, "--out", tmp_path / "again", "--json")[1]
    assert json.loads(printed)["schema"] == "perceptree.data-written/1"
    before = read_dataset(export, "test")
    splits = {split: read_dataset(out, split).frames for split in ("train", "val", "test")}
    assert sum(map(len, splits.values())) == len(before.frames)
    trees = [tree for frames in splits.values() for one in frames for tree in one.trees]
    assert len(trees) == sum(len(one.trees) for one in before.frames)
    assert not Check(out).run().findings


def test_a_copy_keeps_what_the_simulator_says(export: Path, call: Call, tmp_path: Path) -> None:
    labels = export / "instances_default.json"
    content = json.loads(labels.read_text())
    of_image = {
        "depth_sensor": {"kind": "tof"},
        "pose": {"carrier": "mast"},
        "realism": {"grass_cover": 0.5},
        "time_s": 1.5,
        "pose_world": {"origin_m": [0, 0, 1], "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]},
    }
    of_tree = {
        "diameter_height_m": 0.6,
        "diameter_breast_m": 0.28,
        "position_m": [0.5, 1.0, 4.9],
        "position_world_m": [4.9, -0.5, 0.2],
        "model": "old post",
        "stem": 7,
    }
    for image in content["images"]:
        image |= of_image
    for tree in content["annotations"]:
        tree |= of_tree
    labels.write_text(json.dumps(content))
    owed = [{"kind": "bark", "source": "someone", "licence": "CC0", "names": ["oak"]}]
    settings = {"settings": {"labels": {"reach_m": 12.0}}, "textures": owed, "seed": 3}
    (export / "settings.json").write_text(json.dumps(settings))

    for source, name in ((export, "folder"), (labels, "file")):
        out = tmp_path / name
        assert call("data", "split", source, "--out", out, "--val", 0.25, "--test", 0.25)[0] == 0
        assert json.loads((out / "settings.json").read_text()) == {
            "textures": owed,
            "reach_m": 12.0,
        }
        copied = json.loads((out / "train_RGB.json").read_text())
        check_schema(copied, "perceptree.labels")
        assert all(of_image.items() <= image.items() for image in copied["images"])
        assert all(of_tree.items() <= tree.items() for tree in copied["annotations"])
        of_mask = {tree["area"] for tree in content["annotations"]}
        assert {tree["area"] for tree in copied["annotations"]} <= of_mask
    assert call("data", "convert", out, "--out", tmp_path / "again")[0] == 0
    assert json.loads((tmp_path / "again" / "settings.json").read_text())["reach_m"] == 12.0


def test_the_area_of_a_copied_tree_is_that_of_its_mask(
    export: Path, call: Call, tmp_path: Path
) -> None:
    labels = export / "instances_default.json"
    content = json.loads(labels.read_text())
    tree = content["annotations"][0]
    left, top, wide, high = tree["bbox"]
    tree["segmentation"] = [[left, top, left + wide, top, left, top + high]]  # half of the box
    labels.write_text(json.dumps(content))
    assert call("data", "convert", export, "--out", tmp_path / "copy")[0] == 0
    copied = json.loads((tmp_path / "copy" / "annotations.json").read_text())["annotations"][0]
    assert copied["area"] == pytest.approx(wide * high / 2, rel=0.2)


def test_one_export_trains_with_a_split_that_is_told(
    export: Path, call: Call, tmp_path: Path
) -> None:
    arguments = ("--modality", "rgb", "--steps", 1, "--batch", 1, "--workers", 0)
    sizes = ("--height", 64, "--width", 64)
    code, _, errors = call("train", export, "--out", tmp_path / "run", *arguments, *sizes)
    assert code == 0, errors
    assert "instances_default.json names no split: 1 of 8 pictures are val" in errors
    assert "perceptree data split" in errors


def test_masks_and_keypoints_of_two_files_are_merged(
    export: Path, call: Call, tmp_path: Path
) -> None:
    whole = json.loads((export / "instances_default.json").read_text())
    points = json.loads(json.dumps(whole))
    for annotation in whole["annotations"]:
        annotation["keypoints"] = []
    for annotation in points["annotations"]:
        annotation["segmentation"] = []
    (export / "instances_default.json").write_text(json.dumps(whole))
    (export / "points.json").write_text(json.dumps(points))
    out = tmp_path / "merged"
    given = (export / "instances_default.json", export / "points.json")
    code, _, errors = call("data", "merge", *given, "--out", out)
    assert code == 0, errors
    dataset = read_dataset(out, "test")
    assert dataset.has_masks
    assert dataset.has_keypoints
