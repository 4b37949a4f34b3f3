"""What a form cannot hold, and what a file says wrongly, is told with its number."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import encode_rle

Call = Callable[..., tuple[int, str, str]]
Edit = Callable[..., None]


@pytest.mark.parametrize("form", ["yolo-seg", "labelme"])
def test_holes_and_small_parts_of_masks(
    posts: Path, tmp_path: Path, call: Call, edit_split: Edit, form: str
) -> None:
    def change(content: dict[str, Any]) -> None:
        for place, tree in enumerate(content["annotations"][:3]):
            mask = np.zeros((72, 128), bool)
            mask[8:60, 20:40] = True
            if place < 2:
                mask[30:34, 25:30] = False  # a hole
                mask[31, 27] = True  # in which something lies, which is filled with it
            if place > 1:
                mask[10, 60] = True  # a part of one cell
            tree["segmentation"] = encode_rle(mask)

    edit_split(posts, "train", change)
    labels = posts / "train_RGB.json"
    code, _, errors = call("data", "convert", labels, "--out", tmp_path / "out", "--to", form)
    assert code == 0, errors
    assert "masks whose holes are filled, as outlines hold none: 2" in errors
    assert "masks that lose parts smaller than 1 % of their largest part: 1" in errors


@pytest.mark.parametrize("form", ["coco", "yolo-seg", "labelme"])
def test_pictures_of_another_size_than_their_labels(
    posts: Path, tmp_path: Path, call: Call, edit_split: Edit, form: str
) -> None:
    def enlarge(content: dict[str, Any]) -> None:
        for image in content["images"][:2]:
            image |= {"width": 256, "height": 144}
        for tree in content["annotations"]:
            tree["segmentation"] = [[10, 10, 20, 10, 20, 40]]

    edit_split(posts, "train", enlarge)
    labels = posts / "train_RGB.json"
    code, _, errors = call("data", "convert", labels, "--out", tmp_path / "out", "--to", form)
    assert code == 0, errors
    assert "2 pictures of another size than in the labels" in errors
    assert "is 128x72 px and in its labels 256x144 px" in errors


@pytest.mark.parametrize("key", ["images", "bbox"])
def test_a_key_that_is_given_twice_is_refused(
    posts: Path, tmp_path: Path, call: Call, key: str
) -> None:
    labels = posts / "train_RGB.json"
    labels.write_text(labels.read_text().replace(f'"{key}": ', f'"{key}": [], "{key}": ', 1))
    code, _, errors = call("data", "convert", labels, "--out", tmp_path / "out")
    assert code == 2
    assert f"{labels}: not readable JSON ({key} is given twice)" in errors
