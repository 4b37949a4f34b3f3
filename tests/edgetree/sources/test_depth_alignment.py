"""Depth whose CameraInfo or frame says that it is not in the pixels of the colour."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calib
from calib import PinholeCamera, RigidTransform
from edgetree.frames.rig import Rig
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.source import DEPTH_PLACED_BY_GUESS

COLOUR = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)
WIDER = PinholeCamera(64, 48, 42.0, 42.0, 31.5, 23.5)
BENT = PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5, (-0.3, 0.1, 0.0, 0.0, 0.0))
NEARBY = PinholeCamera(64, 48, 60.001, 60.0, 31.5, 23.5)
SHIFT = RigidTransform.from_euler_deg(0, 0, 0, (0.05, 0.0, 0.0))
Write = Callable[..., Path]


@pytest.fixture
def write(bags: Any, tmp_path: Path) -> Write:
    """A function that writes a frame whose depth has a topic, camera, size and frame of its own."""

    def written(
        camera: PinholeCamera | None,
        *,
        topic: str = "/cam/depth/image_raw",
        frames: tuple[str, str] = ("cam", "cam"),
        step: int = 1,
        transform: RigidTransform | None = None,
    ) -> Path:
        frame, stamp = bags.small_frame(), bags.START_NS
        with bags.BagFile(tmp_path) as bag:
            if transform is not None:
                bag.tf(frames[0], frames[1], transform, stamp, "/tf_static")
            bag.info(bags.INFO, COLOUR, stamp, frames[0])
            bag.image(bags.COLOUR, frame.image, stamp, frame=frames[0])
            if camera is not None:
                bag.info(f"{topic.rpartition('/')[0]}/camera_info", camera, stamp, frames[1])
            bag.image(topic, frame.depth[::step, ::step], stamp, "16UC1", frames[1])
        path: Path = bag.path
        return path

    return written


def depth_of(bags: Any) -> np.ndarray:
    return np.asarray(bags.small_frame().depth / 1000, np.float32)


@pytest.mark.parametrize("camera", [COLOUR, NEARBY, None])
@pytest.mark.parametrize("frames", [("cam", "cam"), ("", "")])
def test_depth_of_the_same_lens_stays_as_it_is(
    bags: Any, write: Write, camera: PinholeCamera | None, frames: tuple[str, str]
) -> None:
    source = open_recording(write(camera, frames=frames))
    (frame,) = source
    np.testing.assert_array_equal(frame.depth_m, depth_of(bags))
    assert not source.counts


@pytest.mark.parametrize("camera", [WIDER, BENT])
@pytest.mark.parametrize("frames", [("cam", "cam"), ("", "")])
@pytest.mark.parametrize("topic", ["/cam/depth/image_raw", "/cam/aligned_depth_to_color/image_raw"])
def test_depth_of_another_lens_is_registered_and_counted(
    bags: Any,
    write: Write,
    caplog: pytest.LogCaptureFixture,
    camera: PinholeCamera,
    frames: tuple[str, str],
    topic: str,
) -> None:
    source = open_recording(write(camera, frames=frames, topic=topic))
    (frame,) = source
    expected = calib.register_depth(depth_of(bags), camera, COLOUR, RigidTransform.identity())
    np.testing.assert_array_equal(frame.depth_m, expected)
    assert source.counts == {DEPTH_PLACED_BY_GUESS: 1}
    assert f"depth of {topic} is 64x48 px, focal length {camera.fx:.1f} px, in frame" in caplog.text
    assert "it is not aligned, and no transform says where" in caplog.text


def test_depth_of_another_size_and_lens_is_registered_and_counted(bags: Any, write: Write) -> None:
    small = WIDER.scaled(32, 24)
    source = open_recording(write(small, step=2))
    (frame,) = source
    expected = calib.register_depth(
        depth_of(bags)[::2, ::2], small, COLOUR, RigidTransform.identity()
    )
    np.testing.assert_array_equal(frame.depth_m, expected)
    assert source.counts == {DEPTH_PLACED_BY_GUESS: 1}


def test_smaller_depth_of_the_same_lens_is_no_guess(write: Write) -> None:
    source = open_recording(write(COLOUR.scaled(32, 24), step=2))
    (frame,) = source
    assert frame.depth_m is not None
    assert frame.depth_m.shape == (48, 64)
    assert not source.counts


@pytest.mark.parametrize("topic", ["/cam/depth/image_raw", "/cam/depth_registered/image_raw"])
def test_a_known_transform_is_used_in_spite_of_the_name(
    bags: Any, write: Write, topic: str
) -> None:
    path = write(WIDER, topic=topic, frames=("cam", "cam_depth"), transform=SHIFT)
    source = open_recording(path)
    (frame,) = source
    expected = calib.register_depth(depth_of(bags), WIDER, COLOUR, SHIFT)
    np.testing.assert_array_equal(frame.depth_m, expected)
    assert DEPTH_PLACED_BY_GUESS not in source.counts


def test_depth_called_unregistered_is_not_taken_as_registered(
    write: Write, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(COLOUR, topic="/cam/depth_unregistered/image", frames=("cam", "elsewhere"))
    source = open_recording(path)
    (frame,) = source
    assert frame.depth_fault is not None
    assert "tf has no transform between them" in frame.depth_fault
    assert source.counts["depth not aligned"] == 1


def test_depth_called_aligned_is_so_without_a_camera_of_its_own(bags: Any, write: Write) -> None:
    path = write(None, topic="/cam/aligned_depth/image", frames=("cam", "elsewhere"))
    (frame,) = open_recording(path)
    np.testing.assert_array_equal(frame.depth_m, depth_of(bags))


def test_a_line_says_that_nothing_tells_where_the_depth_is(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, frame.image, bags.START_NS, frame="")
        bag.image(bags.DEPTH, frame.depth, bags.START_NS, "16UC1", frame="")
    (live,) = open_recording(bag.path)
    np.testing.assert_array_equal(live.depth_m, depth_of(bags))
    assert f"neither a frame nor a CameraInfo says where depth of {bags.DEPTH} was" in caplog.text


def test_cameras_of_one_frame_that_differ_are_not_guessed(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        bag.image("/pictures/image", frame.image, bags.START_NS)
        for number in range(2):
            camera = replace(COLOUR, fx=60.0 + 10 * number)
            bag.info(f"/info_{number}/camera_info", camera, bags.START_NS)
    (live,) = open_recording(bag.path)
    assert live.camera is None
    assert "state different lenses for frame 'cam_optical'" in caplog.text
    (named,) = open_recording(bag.path, topics={"camera": "/info_1/camera_info"})
    assert named.camera is not None
    assert named.camera.fx == 70.0


def test_a_given_camera_takes_the_place_of_the_recorded_one(bags: Any, write: Write) -> None:
    """Depth of another place is moved into the pixels of the given camera."""
    path = write(WIDER, frames=("cam", "depth"), transform=SHIFT)
    given = replace(COLOUR, fx=50.0)

    (frame,) = open_recording(path, rig=Rig(camera=given))

    assert frame.camera == given
    assert frame.depth_is_moved
    expected_m = calib.register_depth(depth_of(bags), WIDER, given, SHIFT)
    np.testing.assert_allclose(frame.depth_m, expected_m, atol=2e-3)


def test_aligned_depth_stays_so_with_a_given_camera(bags: Any, write: Write) -> None:
    (frame,) = open_recording(write(COLOUR), rig=Rig(camera=replace(COLOUR, fx=50.0)))

    assert not frame.depth_is_moved
    np.testing.assert_array_equal(frame.depth_m, depth_of(bags))


def test_a_range_is_taken_along_the_rays_of_the_given_camera(bags: Any, write: Write) -> None:
    given = replace(COLOUR, fx=50.0, fy=50.0)

    (frame,) = open_recording(write(COLOUR), rig=Rig(camera=given, depth_kind="range"))

    expected_m = calib.range_to_depth(depth_of(bags), given)
    np.testing.assert_allclose(frame.depth_m, expected_m, rtol=1e-5)
