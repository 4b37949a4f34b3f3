"""Exact depth of simulated frames as what is trained on."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from perceptree.data import read_dataset, read_split
from perceptree.data.cache import open_cache
from perceptree.data.exact import with_exact_depth
from perceptree.data.exchange.write_coco import write_coco
from perceptree.data.frames import load_sample
from perceptree.errors import DatasetError
from perceptree.models import make_spec

POST_M, WALL_M = 5.0, 12.0
Write = Callable[[int], Path]


@pytest.fixture
def exact_posts(posts: Path) -> Write:
    """Gives the frames of `posts` exact depth of every n-th pixel, without the wall."""

    def write(stride: int) -> Path:
        for split in ("train", "val"):
            path = posts / f"{split}_RGB.json"
            content = json.loads(path.read_text())
            (posts / "depth_exact").mkdir(exist_ok=True)
            for image in content["images"]:
                depth_m = calib.read_depth(posts / image["depth_file"])[::stride, ::stride]
                name = f"depth_exact/{image['id']:06d}.png"
                depth_m = np.where(depth_m > POST_M + 1, 0, depth_m).astype(np.float32)
                calib.write_depth(posts / name, depth_m)
                image |= {"depth_exact_file": name, "depth_exact_stride_px": stride}
            path.write_text(json.dumps(content))
        return posts

    return write


@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("size", [(72, 128), (36, 64), (144, 256)])
def test_edges_lie_where_the_labels_have_them(
    exact_posts: Write, stride: int, size: tuple[int, int]
) -> None:
    spec = make_spec("edge-n", "depth", *size)
    for frame in with_exact_depth(read_split(exact_posts(stride), "train")):
        sample = load_sample(frame, spec)
        assert sample.exact
        assert sample.masks is not None
        read, trees = sample.image != 255, sample.masks.any(0)
        assert read[trees].all()
        assert (read & ~trees).sum() <= 0.06 * trees.sum()
        assert np.median(sample.image[trees]) == round(POST_M / 20 * 255)


def test_the_cache_knows_exact_depth(exact_posts: Write, tmp_path: Path) -> None:
    spec = make_spec("edge-n", "depth", 72, 128)
    frames = read_split(exact_posts(2), "train")
    measured = open_cache(frames, spec, tmp_path / "measured")
    exact = open_cache(with_exact_depth(frames), spec, tmp_path / "exact")
    assert (measured.key != exact.key, measured[0].exact, exact[0].exact) == (True, False, True)
    assert (measured[0].image == 255).sum() == 0
    assert (exact[0].image == 255).any()


def test_a_copy_of_a_dataset_keeps_its_exact_depth(exact_posts: Write, tmp_path: Path) -> None:
    frames = read_split(exact_posts(2), "train")
    write_coco(tmp_path / "copy", {"train": frames})
    copied = with_exact_depth(read_split(tmp_path / "copy", "train"))
    assert {frame.exact_stride_px for frame in copied} == {2}
    for one, other in zip(frames, copied, strict=True):
        assert one.exact_path is not None
        assert other.exact_path is not None
        assert other.exact_path.read_bytes() == one.exact_path.read_bytes()


def test_frames_without_exact_depth_are_named(posts: Path) -> None:
    with pytest.raises(DatasetError, match=r"000000\.png: the dataset has no exact depth for it"):
        with_exact_depth(read_split(posts, "train"))


def test_a_file_of_another_size_is_named(exact_posts: Write) -> None:
    folder = exact_posts(2)
    cv2.imwrite(str(folder / "depth_exact/000000.png"), np.zeros((10, 10), np.uint16))
    frame = with_exact_depth(read_split(folder, "train"))[0]
    with pytest.raises(DatasetError, match=r"000000\.png: is 10x10 px, expected 64x36"):
        load_sample(frame, make_spec("edge-n", "depth", 72, 128))


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        ({"depth_exact_file": 3}, "depth_exact_file"),
        ({"depth_exact_stride_px": 0}, "at least 1 px"),
    ],
)
def test_broken_fields_are_named(
    posts: Path, edit_split: Callable[..., None], value: dict[str, Any], expected: str
) -> None:
    edit_split(posts, "train", lambda content: content["images"][0].update(value))
    with pytest.raises(DatasetError, match=expected):
        read_dataset(posts, "train")


def test_training_draws_cameras_on_exact_depth(
    exact_posts: Write, tmp_path: Path, call: Callable[..., Any]
) -> None:
    folder = exact_posts(2)
    code, _, err = call(
        *("train", folder, "--out", tmp_path / "run", "--mix", folder, "--exact-depth"),
        *("--steps", 1, "--batch", 2, "--height", 64, "--width", 128),
    )
    assert code == 0, err
    assert sorted(path.name for path in (folder / ".frame-cache").iterdir()) == [
        "train_RGB-depth-128x64",
        "train_RGB-depth-128x64-exact",
    ]


def test_exact_depth_is_for_depth_models(
    posts: Path, tmp_path: Path, call: Callable[..., Any]
) -> None:
    code, _, err = call(
        *("train", posts, "--out", tmp_path / "run", "--exact-depth", "--modality", "rgb"),
        *("--steps", 1, "--batch", 2, "--height", 64, "--width", 128),
    )
    assert (code, "expected no --exact-depth" in err) == (2, True)
    assert len(err.strip().splitlines()) == 1
