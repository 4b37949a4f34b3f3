"""Exports of labelling tools: found by content, two files joined, one without split."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from perceptree.data import read_dataset, read_split
from perceptree.data.check import Check
from perceptree.errors import DatasetError

Content = dict[str, Any]
Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def export(write_dataset: Callable[..., Path]) -> Path:
    """A folder of pictures, and their labels in the file `train_RGB.json` alone."""
    folder = write_dataset(train=6, val=1, test=1)
    for split in ("val", "test"):
        (folder / f"{split}_RGB.json").unlink()
    return folder


@pytest.mark.parametrize(
    ("name", "split"),
    [
        ("result.json", "test"),
        ("annotations/person_keypoints_default.json", "test"),
        ("annotations/instances_default.json", "test"),
        ("labels_my-project_2026-11-02.json", "test"),
        ("job_7/export.json", "test"),
        ("train/_annotations.coco-segmentation.json", "train"),
        ("valid/result.json", "val"),
        ("trainset_val.json", "val"),
        ("5.json", "test"),
        ("___.json", "test"),
    ],
)
def test_a_file_with_coco_labels_is_found(export: Path, name: str, split: str) -> None:
    (export / name).parent.mkdir(exist_ok=True)
    (export / "train_RGB.json").rename(export / name)
    (export / "settings.json").write_text('{"images": [], "seed": 1}')
    dataset = read_dataset(export, split)
    assert dataset.labels.path == export / name
    assert sum(len(frame.trees) for frame in dataset.frames) == 9
    assert all(frame.image_path.is_file() for frame in dataset.frames)
    taken = f"{Path(name).name} names no split: taken as test"
    assert (taken in dataset.notes) == (split == "test")


@pytest.mark.parametrize("name", ["captions.json", "panoptic_default.json", "stuff.json"])
def test_other_kinds_of_labels_are_not_taken(export: Path, name: str) -> None:
    (export / "train_RGB.json").rename(export / name)
    with pytest.raises(DatasetError) as caught:
        read_split(export, "train")
    assert f"no COCO labels (images, annotations, categories) in {name}" in str(caught.value)


def test_files_are_told_by_content_only_where_no_name_fits(export: Path) -> None:
    (export / "result.json").write_text((export / "train_RGB.json").read_text())
    with pytest.raises(DatasetError, match=r"expected labels of test.*; found train_RGB\.json$"):
        read_split(export, "test")


def test_one_export_says_how_it_is_divided(export: Path, call: Call, tmp_path: Path) -> None:
    path = export / "annotations/instances_default.json"
    path.parent.mkdir()
    (export / "train_RGB.json").rename(path)
    for given in (export, path):
        code, _, errors = call("data", "show", given, "--split", "val", "--out", tmp_path / "pages")
        assert code == 2
        assert "instances_default.json" in errors
        assert "perceptree data split divides it into train, val and test" in errors
        assert len(errors.strip().splitlines()) == 1


def write_both(
    export: Path, change: Callable[[Content, Content], None], subset: str = "Train"
) -> Path:
    """Write masks and keypoints to two files, as CVAT does."""
    masks = json.loads((export / "train_RGB.json").read_text())
    points = json.loads((export / "train_RGB.json").read_text())
    (export / "train_RGB.json").unlink()
    del masks["categories"][0]["keypoints"]
    for annotation in masks["annotations"]:
        del annotation["keypoints"], annotation["num_keypoints"]
    for annotation in points["annotations"]:
        x, y = annotation["keypoints"][:12:3], annotation["keypoints"][1:12:3]
        annotation["bbox"] = [min(x), min(y), max(x) - min(x), max(y) - min(y)]
        annotation["segmentation"] = []
    change(masks, points)
    folder = export / "annotations"
    folder.mkdir()
    (folder / f"instances_{subset}.json").write_text(json.dumps(masks))
    (folder / f"person_keypoints_{subset}.json").write_text(json.dumps(points))
    return export


def shuffle(masks: Content, points: Content) -> None:
    """Give the second file other ids, in another order."""
    for image in points["images"]:
        image["id"] = f"image-{image['id']}"
    for annotation in points["annotations"]:
        annotation["image_id"] = f"image-{annotation['image_id']}"
        annotation["id"] += 100
    points["annotations"].reverse()
    points["images"].reverse()


@pytest.mark.parametrize("change", [lambda masks, points: None, shuffle])
def test_masks_and_keypoints_of_two_files_are_joined(
    export: Path, change: Callable[[Content, Content], None]
) -> None:
    expected = read_split(export, "train")
    dataset = read_dataset(write_both(export, change), "train")
    assert (
        "keypoints of person_keypoints_Train.json are joined to 9 of 9 annotations"
        in (dataset.notes[0])
    )
    for frame, like in zip(dataset.frames, expected, strict=True):
        for tree, other in zip(frame.trees, like.trees, strict=True):
            assert (tree.keypoints == other.keypoints).all()
            assert (frame.mask(tree) == like.mask(other)).all()


@pytest.mark.parametrize(("subset", "split"), [("default", "test"), ("val2017", "val")])
def test_two_files_of_any_subset_are_joined(export: Path, subset: str, split: str) -> None:
    dataset = read_dataset(write_both(export, shuffle, subset), split)
    assert f"keypoints of person_keypoints_{subset}.json are joined to 9 of 9" in dataset.notes[0]
    assert dataset.has_masks
    assert dataset.has_keypoints


def test_keypoints_without_a_mask_are_left_out_and_named(export: Path) -> None:
    def change(masks: Content, points: Content) -> None:
        masks["annotations"] = [one for one in masks["annotations"] if one["id"] != 3]

    folder = write_both(export, change)
    dataset = read_dataset(folder, "train")
    assert dataset.tally.left_out == [("keypoints_alone", 3)]
    assert "joined to 8 of 8 annotations" in dataset.notes[0]
    (finding,) = Check(folder).run().findings
    assert (finding.kind, finding.first) == ("keypoints_alone", ("train annotation 3",))


def test_masks_without_keypoints_stay_trees(export: Path) -> None:
    def change(masks: Content, points: Content) -> None:
        points["annotations"] = points["annotations"][:4]

    dataset = read_dataset(write_both(export, change), "train")
    assert "joined to 4 of 9 annotations" in dataset.notes[0]
    assert sum(len(frame.trees) for frame in dataset.frames) == 9


def test_files_of_other_pictures_are_not_joined(export: Path) -> None:
    def change(masks: Content, points: Content) -> None:
        for image in points["images"]:
            image["file_name"] = f"other/{image['file_name']}"

    with pytest.raises(DatasetError, match=r"shares no picture with person_keypoints_Train\.json"):
        read_split(write_both(export, change), "train")


def test_a_picture_of_too_many_pairs_is_refused(
    export: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("perceptree.data.joining._MOST_PAIRS", 3)
    with pytest.raises(DatasetError, match="2 annotations with keypoints and 2 with boxes"):
        read_split(write_both(export, lambda masks, points: None), "train")


def test_one_box_gets_the_keypoints_that_fit_it_best(export: Path) -> None:
    def change(masks: Content, points: Content) -> None:
        masks["annotations"] = [one for one in masks["annotations"] if one["id"] != 2]
        masks["annotations"][1]["bbox"] = [40, 8, 88, 52]
        listed = points["annotations"][1]["keypoints"]  # the other post of the second picture
        listed[:12:3] = [x + 40 for x in listed[:12:3]]

    folder = write_both(export, change)
    dataset = read_dataset(folder, "train")
    assert [len(frame.trees) for frame in dataset.frames[:2]] == [1, 1]
    assert dataset.tally.left_out == [("keypoints_alone", 2)]
