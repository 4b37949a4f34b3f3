"""EXIF orientations in a dataset: the size in the label file tells which way up a picture is."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from picture_files import exif, jpeg, jpeg_segment

from basetree.files.headers.exif import turned_upright
from perceptree.data import read_dataset, read_frame
from perceptree.data.check import Check
from perceptree.errors import DatasetError

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def turn(posts: Path) -> Callable[..., np.ndarray]:
    """Writes the first picture of val with an orientation; returns its stored pixels."""

    def write(orientation: int, *, labels_upright: bool = False) -> np.ndarray:
        path = posts / "val_RGB.json"
        content: dict[str, Any] = json.loads(path.read_text())
        image = content["images"][0]
        rows, columns = np.indices((image["height"], image["width"]))
        stored = np.stack([2 * rows, columns, rows + columns], axis=-1).astype(np.uint8)
        mark = jpeg_segment(0xE1, b"Exif\0\0" + exif(orientation))
        name = posts / image["file_name"]
        name.write_bytes(jpeg(stored, mark, options=(cv2.IMWRITE_JPEG_QUALITY, 100)))
        if labels_upright:
            image["height"], image["width"] = turned_upright(stored, orientation).shape[:2]
            content["annotations"] = [
                a for a in content["annotations"] if a["image_id"] != image["id"]
            ]
        path.write_text(json.dumps(content))
        return stored

    return write


@pytest.mark.parametrize("orientation", range(2, 9))
def test_a_picture_stays_as_stored_if_its_labels_have_that_size(
    posts: Path, turn: Callable[..., np.ndarray], orientation: int
) -> None:
    stored = turn(orientation)
    dataset = read_dataset(posts, "val")
    found = read_frame(dataset.frames[0], "rgb")
    assert np.abs(found.astype(int) - stored).mean() < 4
    assert f"EXIF orientation {orientation}" in dataset.notes[0]
    val = Check(posts).run().splits[1]
    assert val.notes[-1].startswith("1 pictures with an EXIF orientation are read as stored")


@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_picture_is_turned_if_its_labels_have_that_size(
    posts: Path, turn: Callable[..., np.ndarray], orientation: int
) -> None:
    stored = turn(orientation, labels_upright=True)
    frame = read_dataset(posts, "val").frames[0]
    found = read_frame(frame, "rgb")
    assert found.shape == (frame.height, frame.width, 3)
    upright = turned_upright(stored, orientation)
    assert np.abs(found.astype(int) - upright).mean() < 4
    report = Check(posts).run()
    assert report.splits[1].notes[-1].startswith("1 pictures are turned as EXIF says")
    assert {finding.kind for finding in report.findings} <= {"depth_size"}


def test_a_size_that_fits_neither_way_names_the_orientation(
    posts: Path, turn: Callable[..., np.ndarray]
) -> None:
    turn(6)
    frame = read_dataset(posts, "val").frames[0]
    small = type(frame)(
        frame.image_id, frame.image_path, None, None, 60, 40, frame.extra, frame.trees
    )
    with pytest.raises(DatasetError, match=r"is 128x72 px as stored .EXIF orientation 6, .*60x40"):
        read_frame(small, "rgb")
