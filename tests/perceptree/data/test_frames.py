"""Decoding and letterboxing of frames with their labels."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from perceptree.data import FrameStore, read_split
from perceptree.errors import DatasetError
from perceptree.models import make_spec

Edit = Callable[[Path, str, Callable[[dict[str, Any]], None]], None]


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_labels_match_the_letterboxed_image(posts: Path, modality: Any) -> None:
    spec = make_spec("edge-n", modality, 64, 96)  # 128x72 becomes 96x54, with ten rows of padding
    store = FrameStore(read_split(posts, "train"), spec)
    assert len(store) == 6
    assert store.trees == 9
    sample = store[1]
    assert sample.image.shape == ((64, 96, 3) if modality == "rgb" else (64, 96))
    assert sample.image.dtype == np.uint8
    assert (sample.image[54:] == spec.pad_value).all()
    grey = sample.image if modality == "depth" else sample.image[..., 0]
    post = grey < 108 if modality == "depth" else grey > 105
    assert (post[:54] != sample.masks.any(0)[:54]).mean() < 0.02
    for row in range(2):
        x0, y0, x1, y1 = sample.boxes[row]
        mask = sample.masks[row]
        columns, rows = np.nonzero(mask.any(0))[0], np.nonzero(mask.any(1))[0]
        assert abs(columns[0] - x0) <= 0.5
        assert abs(columns[-1] + 1 - x1) <= 0.5
        assert abs(rows[0] - y0) <= 0.5
        assert abs(rows[-1] + 1 - y1) <= 0.5
        assert sample.keypoints[row, 1, 0] == pytest.approx(x0)
        assert sample.keypoints[row, 2, 0] == pytest.approx(x1)
        assert sample.keypoints[row, 4].tolist() == [0, 0, 0]


def test_halving_the_images_keeps_the_masks_area(posts: Path) -> None:
    store = FrameStore(read_split(posts, "train"), make_spec("edge-n", "depth", 64, 64))
    ratios = []
    for index, frame in enumerate(store.frames):
        whole = [frame.mask(tree).sum() for tree in frame.trees]
        ratios += list(4 * store[index].masks.sum((1, 2)) / whole)
    assert len(ratios) == 9
    assert ratios == pytest.approx([1.0] * 9, abs=0.02)


def test_targets_have_the_shapes_that_the_model_trains_on(posts: Path) -> None:
    targets = FrameStore(read_split(posts, "train"), make_spec("edge-n", "depth", 64, 96))[
        1
    ].targets()
    assert targets.boxes.shape == (2, 4)
    assert targets.keypoints.shape == (2, 5, 3)
    assert targets.masks.shape == (2, 64, 96)


def test_frames_without_trees_and_crowds_are_supported(posts: Path, edit_split: Edit) -> None:
    def change(content: dict[str, Any]) -> None:
        content["annotations"] = [a for a in content["annotations"] if a["image_id"] != 0]
        content["annotations"][0].update(iscrowd=1, keypoints=[])

    edit_split(posts, "train", change)
    store = FrameStore(read_split(posts, "train"), make_spec("edge-n", "depth", 64, 96))
    assert store.trees == 7
    assert store[0].targets().masks.shape == (0, 64, 96)
    assert len(store[1].boxes) == 1


def _unreadable(posts: Path) -> None:
    (posts / "depth8/000000.png").write_bytes(b"nothing")


def _missing(posts: Path) -> None:
    (posts / "depth8/000000.png").unlink()


def _small(posts: Path) -> None:
    cv2.imwrite(str(posts / "depth8/000000.png"), np.zeros((36, 64), np.uint8))


def _sixteen_bit(posts: Path) -> None:
    cv2.imwrite(str(posts / "depth8/000000.png"), np.zeros((72, 128), np.uint16))


@pytest.mark.parametrize(
    ("damage", "expected"),
    [
        (_unreadable, "not a readable image"),
        (_missing, "missing"),
        (_small, "is 64x36 px, expected 128x72"),
        (_sixteen_bit, "expected 8-bit single-channel"),
    ],
)
def test_a_bad_image_is_named_in_one_line(
    posts: Path, damage: Callable[[Path], None], expected: str
) -> None:
    damage(posts)
    with pytest.raises(DatasetError) as caught:
        FrameStore(read_split(posts, "train"), make_spec("edge-n", "depth", 64, 96))[0]
    assert str(posts / "depth8/000000.png") in str(caught.value)
    assert expected in str(caught.value)


def test_depth_of_another_encoding_is_rejected(posts: Path, edit_split: Edit) -> None:
    def change(content: dict[str, Any]) -> None:
        content["images"][0]["depth_encoding"]["far_m"] = 10.0

    edit_split(posts, "train", change)
    frames = read_split(posts, "train")
    with pytest.raises(DatasetError, match=r"its depth_encoding is .*10\.0.*expected the model's"):
        FrameStore(frames, make_spec("edge-n", "depth", 64, 96))[0]
    assert FrameStore(frames, make_spec("edge-n", "rgb", 64, 96))[0].image.shape == (64, 96, 3)


def test_a_dataset_without_depth_trains_colour_only(posts: Path, edit_split: Edit) -> None:
    def change(content: dict[str, Any]) -> None:
        for image in content["images"]:
            del image["depth8_file"]

    edit_split(posts, "train", change)
    frames = read_split(posts, "train")
    assert FrameStore(frames, make_spec("edge-n", "rgb", 64, 96))[0].image.shape == (64, 96, 3)
    with pytest.raises(DatasetError, match=r"has no 8-bit depth image for it; .*--modality rgb"):
        FrameStore(frames, make_spec("edge-n", "depth", 64, 96))[0]
