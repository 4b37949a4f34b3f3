"""Cameras of recordings: rectified pictures, regions, binning and messages without a size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import PinholeCamera
from calib.files import ros
from edgetree.sources.bags.recording import open_recording

BENT = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5, (0.1, -0.05, 0, 0, 0))
P = [70, 0, 30, 0, 0, 71, 22, 0, 0, 0, 1, 0]
OF_P = PinholeCamera(64, 48, 70.0, 71.0, 30.0, 22.0)
Write = Callable[..., Path]


@pytest.fixture
def write(bags: Any, tmp_path: Path) -> Write:
    """A function that writes one picture and its CameraInfo, and returns the path."""

    def written(topic: str, camera: PinholeCamera, kind: str = "mcap", **changed: Any) -> Path:
        with bags.BagFile(tmp_path, kind) as bag:
            if "roi" in changed:
                names = ("x_offset", "y_offset", "width", "height")
                fields = dict(zip(names, changed.pop("roi"), strict=True))
                kind_of_region = "sensor_msgs/msg/RegionOfInterest"
                changed["roi"] = bag.message(kind_of_region, do_rectify=False, **fields)
            bag.image(topic, bags.small_frame().image, bags.START_NS)
            bag.info(f"{topic.rpartition('/')[0]}/camera_info", camera, bags.START_NS, **changed)
        path: Path = bag.path
        return path

    return written


@pytest.mark.parametrize("name", ["image_rect", "image_rectified", "image_undistorted"])
@pytest.mark.parametrize("kind", ["ros1", "mcap"])
def test_rectified_pictures_have_the_lens_p(
    write: Write, caplog: pytest.LogCaptureFixture, name: str, kind: str
) -> None:
    (frame,) = open_recording(write(f"/cam/{name}", BENT, kind, p=P))
    assert frame.camera == OF_P
    line = "is called rectified: its lens is P of CameraInfo, focal length 70.0 px, without"
    assert f"topic /cam/{name} {line}" in caplog.text


@pytest.mark.parametrize("name", ["image_raw", "image_unrectified", "image_color"])
def test_other_pictures_have_the_lens_k_and_d(
    write: Write, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    (frame,) = open_recording(write(f"/cam/{name}", BENT, p=P))
    assert frame.camera == BENT
    line = "is not called rectified: its lens is K and D of CameraInfo, focal length 60.0 px, with"
    assert f"topic /cam/{name} {line}" in caplog.text


def test_nothing_is_said_of_a_lens_without_distortion(
    bags: Any, write: Write, caplog: pytest.LogCaptureFixture
) -> None:
    (frame,) = open_recording(write("/cam/image_rect", bags.small_frame().camera, p=P))
    assert frame.camera == OF_P
    assert "rectified" not in caplog.text


def test_a_rectified_picture_without_p_has_k_and_d_and_a_line_says_so(
    write: Write, caplog: pytest.LogCaptureFixture
) -> None:
    (frame,) = open_recording(write("/cam/image_rect", BENT, p=np.zeros(12)))
    assert frame.camera == BENT
    assert "topic /cam/image_rect is called rectified, and P of CameraInfo is 0" in caplog.text
    assert "its lens is K and D, focal length 60.0 px, with distortion" in caplog.text


def test_p_alone_is_told_with_its_topic_and_not_as_k_and_d(
    write: Write, caplog: pytest.LogCaptureFixture
) -> None:
    (frame,) = open_recording(write("/cam/image_raw", BENT, p=P, k=np.zeros(9)))
    assert frame.camera == OF_P
    assert "topic /cam/camera_info: k is all 0: taken for rectified pictures" in caplog.text
    assert "K and D of CameraInfo" not in caplog.text


def test_a_region_is_not_that_of_whole_pictures(
    write: Write, caplog: pytest.LogCaptureFixture
) -> None:
    (frame,) = open_recording(write("/cam/image_raw", BENT, roi=(0, 0, 32, 24)))
    assert frame.camera == BENT
    assert "/cam/camera_info: the pictures are whole, 64x48 px: its roi is not used" in caplog.text


@pytest.mark.parametrize("name", ["image_raw", "image_rect"])
def test_a_message_without_a_size_has_that_of_the_pictures(
    write: Write, caplog: pytest.LogCaptureFixture, name: str
) -> None:
    (frame,) = open_recording(write(f"/cam/{name}", BENT, p=P, width=0, height=0))
    assert frame.camera == (BENT if name == "image_raw" else OF_P)
    assert "/cam/camera_info states no size: it is taken to be that of the pictures, 64x48 px" in (
        caplog.text
    )


def test_a_message_without_a_size_is_found_by_its_frame(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image("/pictures/image", frame.image, bags.START_NS)
        bag.info("/info/camera_info", frame.camera, bags.START_NS, width=0, height=0)
    (live,) = open_recording(bag.path)
    assert live.camera == frame.camera


def test_a_message_without_a_size_and_with_a_lens_that_none_has_is_said(
    write: Write, caplog: pytest.LogCaptureFixture
) -> None:
    k = np.array([1e9, 0, 31.5, 0, 1e9, 23.5, 0, 0, 1])
    (frame,) = open_recording(write("/cam/image_raw", BENT, k=k, width=0, height=0))
    assert frame.camera is None
    assert "topic /cam/camera_info: " in caplog.text
    assert "there is no camera for 64x48 px" in caplog.text


def test_all_fields_go_to_the_reader_of_camera_files(
    bags: Any, monkeypatch: pytest.MonkeyPatch, write: Write
) -> None:
    seen: list[dict[str, Any]] = []

    def build(values: dict[str, Any]) -> PinholeCamera:
        seen.append(values)
        return OF_P

    monkeypatch.setattr(ros, "build_message", build)
    path = write("/cam/image_rect", BENT, p=P, roi=(8, 4, 64, 48), binning_x=2, binning_y=2)
    (frame,) = open_recording(path)
    assert frame.camera == OF_P
    assert seen[0]["roi"] == {
        "x_offset": 8, "y_offset": 4, "width": 64, "height": 48, "do_rectify": False,
    }  # fmt: skip
    assert (seen[0]["binning_x"], seen[0]["binning_y"]) == (2, 2)
    assert seen[0]["k"][0] == 70.0
    assert seen[0]["p"][:3] == [70, 0, 30]
    assert len(seen[0]["r"]) == 9


@pytest.mark.parametrize("role", ["camera", "depth_camera"])
def test_a_named_camera_is_that_of_depth_without_colour(
    bags: Any, tmp_path: Path, role: str
) -> None:
    small = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image("/cam/depth/image_raw", small.depth, bags.START_NS, "16UC1")
        bag.info("/elsewhere/intrinsics", small.camera, bags.START_NS, frame="another")
    (frame,) = open_recording(bag.path, topics={role: "/elsewhere/intrinsics"})
    assert frame.camera == small.camera
