"""Images, videos and drives as live sources."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import calib
import edgetree
from basetree.errors import InputError
from edgetree.frames import Rig
from edgetree.sources.drive import is_drive, open_drive
from edgetree.sources.files import open_files, open_source
from edgetree.sources.live import open_live_source
from edgetree.sources.opening import open_frames


def test_images_with_depth_and_a_rig(images: Path) -> None:
    camera = calib.load_camera(images.parent / "camera.json")
    rig = Rig(camera, up_camera=(0.0, -2.0, 0.0))
    source = open_files(images, images.parent / "depth", rig=rig, rate_hz=10)
    first, second = source
    assert (first.number, second.number) == (0, 1)
    assert (first.time_s, second.time_s) == (0, 0.1)
    assert first.camera == camera
    np.testing.assert_array_equal(first.up_camera, [0, -1, 0])
    assert first.depth_m is not None
    assert first.depth_m.mean() == pytest.approx(4, abs=0.01)
    assert not source.is_live


@pytest.mark.parametrize(
    "names",
    [
        ["frame1.png", "frame2.png", "frame10.png"],
        ["1_rgb.png", "9_rgb.png", "10_rgb.png"],
        ["0001.png", "0002.png", "0010.png"],
        ["1700.85.png", "1700.9.png"],  # time stamps: decimals are no whole numbers
        ["10.png", "9.png", "start.png"],
    ],
)
def test_pictures_of_a_drive_are_in_the_order_of_their_numbers(
    tmp_path: Path, names: list[str]
) -> None:
    for name in names:
        cv2.imwrite(str(tmp_path / name), np.zeros((48, 64, 3), np.uint8))
    assert [frame.path.name for frame in open_files(tmp_path)] == names


def test_an_image_that_cannot_be_read_is_counted(images: Path) -> None:
    (images / "a.jpg").write_bytes(b"no image")
    source = open_files(images)
    (frame,) = source
    assert frame.number == 1
    assert source.counts == {"unreadable images": 1}
    (again,) = source  # as --loop reads it
    assert again.number == 1
    assert source.counts == {"unreadable images": 2}


def test_videos_have_their_own_times(tmp_path: Path) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 5.0, (64, 48))
    for shade in range(6):
        writer.write(np.full((48, 64, 3), 40 * shade, np.uint8))
    writer.release()
    times = [frame.time_s for frame in open_files(path, rate_hz=100)]
    np.testing.assert_allclose(times, np.arange(6) / 5, atol=0.001)


def test_a_rate_of_0_is_refused(images: Path) -> None:
    with pytest.raises(InputError, match="rate_hz is 0: expected"):
        open_files(images, rate_hz=0)


WriteDrive = Callable[..., Path]


def test_a_drive_has_time_pose_gravity_and_camera(write_drive: WriteDrive) -> None:
    folder = write_drive()
    assert is_drive(folder)
    frames = list(open_drive(folder))
    sample = edgetree.sample_frames()[0]
    np.testing.assert_allclose([frame.time_s for frame in frames], [0, 0.1, 0.2])
    for frame, origin in zip(frames, (2, 1, 0), strict=True):
        np.testing.assert_array_equal(frame.image, sample.image())
        np.testing.assert_array_equal(frame.depth_m, sample.depth_m())
        assert frame.camera == sample.camera
        assert frame.pose is not None
        np.testing.assert_allclose(frame.pose.apply([0, 0, 5]), [origin, 5, 2], atol=1e-9)
        np.testing.assert_allclose(frame.pose.rotate(frame.up_camera), [0, 0, 1], atol=1e-9)


def test_one_of_several_drives_is_chosen_by_number(write_drive: WriteDrive) -> None:
    folder = write_drive(2)
    with pytest.raises(InputError, match="has 2 drives: expected one of the scenes 0, 1"):
        open_drive(folder)
    with pytest.raises(InputError, match="has no scene 5: expected one of 0, 1"):
        open_drive(folder, scene=5)
    poses: list[Any] = [frame.pose for frame in open_drive(folder, scene=1)]
    assert [pose.translation_m[0] for pose in poses] == [5, 4, 3]


def test_broken_labels_are_named(write_drive: WriteDrive) -> None:
    folder = write_drive()
    labels = folder / "test_RGB.json"
    content = json.loads(labels.read_text())
    del content["images"][1]["pose_world"]
    labels.write_text(json.dumps(content))
    with pytest.raises(
        InputError, match=r"read \(its content: images\[1\] has no field 'pose_world'"
    ):
        open_drive(folder)
    labels.write_text("{")
    with pytest.raises(InputError, match=r"test_RGB.json cannot be read"):
        open_drive(folder)


def test_a_frame_of_a_drive_that_cannot_be_read_is_counted(write_drive: WriteDrive) -> None:
    folder = write_drive()
    (folder / "images/000001.jpg").unlink()
    source = open_drive(folder)
    assert [frame.number for frame in source] == [0, 2]
    assert source.counts == {"unreadable images": 1}


def test_paths_of_sources_may_be_texts(images: Path) -> None:
    names = [frame.name for frame in open_source(images)]
    for frames in (open_source(str(images)), open_frames(str(images)), open_live_source(images)):
        assert len(list(frames)) == len(names)
