"""What the trainer's tests share: a small dataset of bright posts, and the command line."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pycocotools import mask as coco_mask
from schema_check import check_printed

import calib
from perceptree.cli import main
from perceptree.keypoints import KEYPOINT_NAMES

WIDTH_PX, HEIGHT_PX = 128, 72
DatasetWriter = Callable[..., Path]
Result = tuple[int, str, str]


def post_annotation(number: int, image_id: int, left_px: int, width_px: int) -> dict[str, Any]:
    """A post from row 8 to 60; its five keypoints lie at known places, on pixel indices."""
    mask = np.zeros((HEIGHT_PX, WIDTH_PX), np.uint8)
    mask[8:60, left_px : left_px + width_px] = 1
    runs = coco_mask.encode(np.asfortranarray(mask))
    middle = left_px + width_px / 2 - 0.5
    right = left_px + width_px - 0.5
    keypoints = [middle, 57.5, 2, left_px - 0.5, 54.5, 2, right, 54.5, 2, middle, 45.5, 1]
    return {
        "id": number,
        "image_id": image_id,
        "category_id": 1,
        "bbox": [left_px, 8, width_px, 52],
        "area": int(mask.sum()),
        "iscrowd": 0,
        "segmentation": {"size": runs["size"], "counts": runs["counts"].decode()},
        "keypoints": [*keypoints, 0, 0, 0],
        "num_keypoints": 4,
        "distance_m": 5.0,
        "diameter_m": 0.3,
        "cut_height_m": 0.2,
        "inclination_deg": 1.0,
        "visible_fraction": 0.9,
        "species": "post",
    }


def write_split(directory: Path, split: str, first: int, frames: int) -> None:
    """One COCO file and its images; frame ``n`` has ``1 + n % 2`` posts."""
    rng = np.random.default_rng(first)
    images: list[dict[str, Any]] = []
    annotations: list[dict[str, Any]] = []
    for image_id in range(first, first + frames):
        image = rng.integers(0, 60, (HEIGHT_PX, WIDTH_PX, 3), np.uint8)
        depth_m = np.full((HEIGHT_PX, WIDTH_PX), 12.0, np.float32)
        for number in range(1 + image_id % 2):
            left, width = int(rng.integers(10, 40)) + 60 * number, int(rng.integers(8, 20))
            image[8:60, left : left + width] += np.uint8(150)
            depth_m[8:60, left : left + width] = 5.0
            annotations.append(post_annotation(len(annotations) + 1, image_id, left, width))
        names = {
            "file_name": f"images/{image_id:06d}.png",
            "depth_file": f"depth/{image_id:06d}.png",
            "depth8_file": f"depth8/{image_id:06d}.png",
        }
        for name in names.values():
            (directory / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(directory / names["file_name"]), image)
        calib.write_depth(directory / names["depth_file"], depth_m)
        encoding = calib.DepthEncoding()
        eight_bit = calib.encode_depth(depth_m, encoding)
        cv2.imwrite(str(directory / names["depth8_file"]), eight_bit)
        more = {
            "id": image_id,
            "width": WIDTH_PX,
            "height": HEIGHT_PX,
            "depth_encoding": encoding.to_dict(),
            "camera": calib.PinholeCamera(WIDTH_PX, HEIGHT_PX, 100, 100, 63.5, 35.5).to_dict(),
            "up_camera": [0.0, -1.0, 0.0],
        }
        images.append(names | more)
    content = {
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "tree", "keypoints": list(KEYPOINT_NAMES)}],
    }
    (directory / f"{split}_RGB.json").write_text(json.dumps(content))


@pytest.fixture
def write_dataset(tmp_path: Path) -> DatasetWriter:
    """Writes a dataset of the given numbers of frames into a new folder."""

    def write(train: int = 6, val: int = 3, test: int = 2) -> Path:
        directory = tmp_path / "posts"
        first = 0
        for split, frames in (("train", train), ("val", val), ("test", test)):
            write_split(directory, split, first, frames)
            first += frames
        return directory

    return write


@pytest.fixture
def posts(write_dataset: DatasetWriter) -> Path:
    """A dataset of a few frames."""
    return write_dataset()


@pytest.fixture
def edit_split() -> Callable[[Path, str, Callable[[dict[str, Any]], None]], None]:
    """Changes a split's COCO file in number."""

    def edit(directory: Path, split: str, change: Callable[[dict[str, Any]], None]) -> None:
        path = directory / f"{split}_RGB.json"
        content = json.loads(path.read_text())
        change(content)
        path.write_text(json.dumps(content))

    return edit


@pytest.fixture
def call(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., Result]:
    """Runs ``perceptree ARGUMENTS``: exit code, stdout, stderr."""

    def run(*arguments: object) -> Result:
        monkeypatch.setattr(sys, "argv", ["perceptree", *map(str, arguments)])
        with pytest.raises(SystemExit) as caught:
            main()
        assert isinstance(caught.value.code, int)
        out, err = capsys.readouterr()
        check_printed(arguments, out)
        return caught.value.code, out, err

    return run
