"""The model that suits a source."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from edgetree.catalogue import DEFAULTS
from edgetree.samples import sample_frames
from edgetree.sources import model_for, open_source

DRIVE = Path(__file__).parents[3] / "edgetree/assets/drive"


@pytest.mark.parametrize(
    ("source", "modality"),
    [
        ("walk.mp4", "rgb"),
        ("0", "rgb"),
        ("/dev/video2", "rgb"),
        ("rtsp://camera/1", "rgb"),
        ("realsense", "depth"),
        ("oak", "depth"),
        ("orbbec", "depth"),
        (DRIVE, "depth"),
        (sample_frames()[0].image_path, "rgb"),
        (sample_frames()[0].image_path.parent, "depth"),
    ],
)
def test_the_model_is_for_what_the_source_has(source: Path | str, modality: str) -> None:
    assert model_for(source) == DEFAULTS[modality]


def test_depth_beside_a_picture_and_depth_alone_are_for_the_depth_model(tmp_path: Path) -> None:
    sample = sample_frames()[0]
    assert model_for(sample.image_path, sample.depth_path) == DEFAULTS["depth"]
    assert model_for(sample.image_path, None, None) == DEFAULTS["rgb"]
    np.save(tmp_path / "a.npy", sample.depth_m())
    assert model_for(tmp_path / "a.npy") == DEFAULTS["depth"]
    (tmp_path / "rgb").mkdir()
    (tmp_path / "depth").mkdir()
    (tmp_path / "rgb/a.jpg").write_bytes(sample.image_path.read_bytes())
    (tmp_path / "depth/a.png").write_bytes(sample.depth_path.read_bytes())
    (tmp_path / "a.npy").unlink()
    assert model_for(tmp_path) == DEFAULTS["depth"]


def test_depth_images_alone_are_for_the_depth_model(tmp_path: Path) -> None:
    frames = sample_frames()
    for frame in frames:
        (tmp_path / f"{frame.name}.png").write_bytes(frame.depth_path.read_bytes())
    one = tmp_path / f"{frames[0].name}.png"
    for source in (tmp_path, one):
        assert model_for(source) == DEFAULTS["depth"]
        found = list(open_source(source))
        assert [frame.image is None and frame.depth_m is not None for frame in found]
        np.testing.assert_allclose(found[0].depth_m, frames[0].depth_m(), atol=1e-6)
    grey = cv2.imread(str(one), cv2.IMREAD_UNCHANGED)
    for number in range(3):  # one picture of 8 bits among them
        cv2.imwrite(str(tmp_path / f"sample_{number}.png"), (grey // 256).astype(np.uint8))
    assert model_for(tmp_path) == model_for(one) == DEFAULTS["rgb"]


def _folder(folder: Path, *names: str) -> Path:
    """Pictures and depth images; those named `grey` have 8 bits."""
    folder.mkdir()
    grey = np.full((48, 64), 200, np.uint8)
    for name in names:
        is_deep = "_depth" in name and "grey" not in name
        assert cv2.imwrite(str(folder / name), grey.astype(np.uint16) * 20 if is_deep else grey)
    return folder


@pytest.mark.parametrize(
    ("names", "modality"),
    [
        (("a.jpg", "a_depth.png", "b.jpg", "b_depth.png", "c.jpg"), "depth"),
        (("grey.jpg", "grey_depth.png"), "rgb"),
        (("a.jpg", "b_depth.png"), "rgb"),
        (("a.jpg", "b.jpg", "c.jpg", "a_depth.png"), "rgb"),
        (("a_depth.png", "b_depth.png"), "depth"),
    ],
)
def test_a_folder_of_pictures_and_their_depth_is_sorted_out_by_names(
    tmp_path: Path, names: tuple[str, ...], modality: str
) -> None:
    assert model_for(_folder(tmp_path / "mixed", *names)) == DEFAULTS[modality]


@pytest.mark.parametrize("depth_only", [False, True])
def test_each_picture_of_a_sorted_folder_has_its_depth(tmp_path: Path, depth_only: bool) -> None:
    folder = _folder(tmp_path / "mixed", "a.jpg", "a_depth.png", "b.jpg", "b_depth.png")
    frames = list(open_source(folder, depth_only=depth_only))
    assert [frame.name for frame in frames] == ["a", "b"]
    assert all(frame.depth_m is not None and frame.depth_m[0, 0] == 4.0 for frame in frames)
    assert all(frame.image is not None for frame in frames)
