"""Label files in which any value is of another kind: read, or refused with one line."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from json_faults import faults

from basetree.errors import InputError
from perceptree.data.check.labels import label_faults
from perceptree.data.dataset import read_labels
from perceptree.data.layouts import LabelFile
from perceptree.keypoints import KEYPOINT_NAMES

SIZE = {"width": 8, "height": 4}
TREE = {"image_id": 1, "category_id": 1, "iscrowd": 0, "ignore": 0, "area": 8, "distance_m": 3.5}
CONTENT: dict[str, Any] = {
    "images": [
        {"id": 1, "file_name": "0.png", **SIZE, "camera": {"fx": 5}, "depth_encoding": {"a": 1}}
    ],
    "categories": [{"id": 1, "name": "tree", "supercategory": "", "keypoints": [*KEYPOINT_NAMES]}],
    "annotations": [
        TREE
        | {"id": 1, "bbox": [1, 0, 2, 4], "keypoints": [1, 3, 2] * 5}
        | {"segmentation": {"size": [4, 8], "counts": [4, 8, 20]}},
        TREE | {"id": 2, "bbox": [1, 0, 2, 4], "segmentation": [[1, 0, 3, 0, 3, 4, 1, 4]]},
    ],
}


def read(path: Path, on_error: Callable[[InputError], object] | None) -> int:
    """Read a file and use what was read; return the number of trees."""
    frames = read_labels(LabelFile("train", None, False, path, path.parent), on_error).frames
    for frame in frames:
        assert list(label_faults(frame)) is not None
    return sum(len(frame.trees) for frame in frames)


def test_any_value_of_another_kind_is_read_or_named(tmp_path: Path) -> None:
    path, read_whole, refused = tmp_path / "train.json", 0, 0
    for what, content in faults(CONTENT):
        path.write_text(json.dumps(content))
        told: list[InputError] = []
        for on_error in (None, told.append):
            try:
                read_whole += read(path, on_error) == 2
            except InputError as error:
                assert str(error).startswith(f"{path}: "), what  # noqa: PT017
                refused += 1
            except Exception as error:  # noqa: BLE001 - what was changed is told
                pytest.fail(f"{what}: {error!r}")
    assert read_whole > 100
    assert refused > 100


@pytest.mark.parametrize("text", ["", "[", "3", '"x"', "[" * 100_000, '{"images": ' + "9" * 5000])
def test_texts_that_are_no_labels(text: str, tmp_path: Path) -> None:
    path = tmp_path / "train.json"
    path.write_text(text)
    with pytest.raises(InputError, match=r"train\.json: "):
        read(path, None)


def test_joined_files_with_any_value_of_another_kind(tmp_path: Path) -> None:
    path, second = tmp_path / "train.json", tmp_path / "keypoints.json"
    labels = LabelFile("train", None, False, path, tmp_path, second)
    path.write_text(json.dumps(CONTENT))
    for what, content in faults(CONTENT):
        second.write_text(json.dumps(content))
        try:
            read_labels(labels)
        except InputError:
            continue
        except Exception as error:  # noqa: BLE001 - what was changed is told
            pytest.fail(f"{what}: {error!r}")
