"""The frames that shards share out are those of one machine, in its order and with its depth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from edgetree.frames.rig import Rig
from edgetree.shards.inputs import list_frames
from edgetree.sources.files import open_source

NUMBERS = (2, 10, 1)
COLOUR = np.zeros((48, 64, 3), np.uint8)
DEPTH = np.tile(np.arange(3000, 3064, dtype=np.uint16), (48, 1))


def write(folder: Path, name: str, pixels: np.ndarray) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in NUMBERS:
        cv2.imwrite(str(folder / name.format(number)), pixels)


def plain(folder: Path) -> None:
    write(folder, "frame_{}.jpg", COLOUR)


def side_by_side(folder: Path) -> None:
    write(folder, "{}.jpg", COLOUR)
    write(folder, "{}_depth.png", DEPTH)


def folders(folder: Path) -> None:
    write(folder / "rgb", "{}.jpg", COLOUR)
    write(folder / "depth", "{}.png", DEPTH)


def depth_alone(folder: Path) -> None:
    write(folder, "{}.png", DEPTH)


def arrays(folder: Path) -> None:
    folder.mkdir()
    for number in NUMBERS:
        np.save(folder / f"{number}.npy", DEPTH / np.float32(1000))


@pytest.mark.parametrize("layout", [plain, side_by_side, folders, depth_alone, arrays])
def test_the_images_of_a_folder_are_those_of_one_machine(tmp_path: Path, layout: object) -> None:
    folder = tmp_path / "walk"
    layout(folder)  # type: ignore[operator]
    expected = list(open_source(folder))
    listed = list_frames(folder, None)
    with listed.frames(0, 2, Rig()) as first, listed.frames(2, 2, Rig()) as second:
        found = [*first.frames, *second.frames]
    assert [(each.name, each.path) for each in found] == [(e.name, e.path) for e in expected]
    for one, other in zip(found, expected, strict=True):
        for name in ("image", "depth_m"):
            here, there = getattr(one, name), getattr(other, name)
            assert (here is None) == (there is None)
            assert here is None or np.array_equal(here, there)


def test_images_at_a_url_have_the_same_order(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    from basetree.jobs import copy_folder, open_store

    plain(tmp_path)
    copy_folder(tmp_path, open_store("memory://order/images"))
    listed = list_frames(Path("memory://order/images"), None)
    assert [each.name for each in listed.entries] == ["frame_1", "frame_2", "frame_10"]


def test_a_ros_2_bag_of_several_files_is_one_recording(tmp_path: Path) -> None:
    """Transforms that stay are in its first file alone."""
    folder = tmp_path / "drive"
    folder.mkdir()
    for name in ("drive_0.db3", "drive_1.db3", "metadata.yaml"):
        (folder / name).write_bytes(b"content")
    listed = list_frames(folder, None)
    assert [each.file for each in listed.entries] == ["drive"]
    assert listed.are_recordings
    (folder / "metadata.yaml").unlink()
    assert [each.file for each in list_frames(folder, None).entries] == [
        "drive_0.db3",
        "drive_1.db3",
    ]


def test_the_capture_of_a_phone_is_one_recording(tmp_path: Path) -> None:
    folder = tmp_path / "capture"
    (folder / "depth").mkdir(parents=True)
    for name in ("rgb.mp4", "camera_matrix.csv"):
        (folder / name).write_bytes(b"content")
    listed = list_frames(folder, None)
    assert [each.file for each in listed.entries] == ["capture"]
    assert listed.are_recordings
