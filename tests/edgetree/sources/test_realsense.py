"""RealSense cameras, against a fake of pyrealsense2 that follows its documentation."""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import calib
from basetree.errors import MissingPackage
from edgetree.sources.cameras import device
from edgetree.sources.cameras.realsense import open_realsense
from edgetree.sources.source import SourceLost

SIZE = (848, 480)


class FakeProfile:
    """A stream profile, also of a started pipeline."""

    def __init__(self, rotation: Any = None, model: str = "distortion.none") -> None:
        self.rotation, self.model = rotation, model

    def as_video_stream_profile(self) -> FakeProfile:
        return self

    def get_intrinsics(self) -> Any:
        width, height = SIZE
        coeffs = [0.1, 0, 0, 0, 0] if "inverse" in self.model else [0.0] * 5
        return SimpleNamespace(
            width=width,
            height=height,
            fx=600.0,
            fy=601.0,
            ppx=420.0,
            ppy=240.0,
            model=self.model,
            coeffs=coeffs,
        )

    def get_extrinsics_to(self, other: Any) -> Any:
        return SimpleNamespace(rotation=self.rotation, translation=[0, 0, 0])


class FakeFrame:
    """A frame of any stream. Like those of the SDK, its memory is used again."""

    def __init__(self, profile: FakeProfile, number: int, data: Any) -> None:
        self.profile, self.number, self.data = profile, number, data

    def __bool__(self) -> bool:
        return self.data is not None

    def get_data(self) -> Any:
        return self.data

    def get_profile(self) -> FakeProfile:
        return self.profile

    def get_frame_number(self) -> int:
        return 100 + self.number

    def get_timestamp(self) -> float:
        return 1_700_000_000_000.0 + 33.0 * self.number

    def as_motion_frame(self) -> FakeFrame:
        return self

    def get_motion_data(self) -> Any:
        x, y, z = self.data
        return SimpleNamespace(x=x, y=y, z=z)


class FakeSdk:
    """The module pyrealsense2 with one camera."""

    stream = SimpleNamespace(color="color", depth="depth", accel="accel", gyro="gyro")
    format = SimpleNamespace(bgr8="bgr8", z16="z16")

    def __init__(self, *, has_imu: bool = True, model: str = "distortion.none") -> None:
        self.has_imu, self.model = has_imu, model
        self.queue: list[dict[str, Any]] = []
        self.is_running = False
        self.config_used: Any = None
        self.is_unplugged = False

    def frames(self, count: int) -> None:
        """Queue frames; the third has no depth."""
        # The IMU is turned by 90 degrees about z: its x is up, where the camera's y is down.
        # librealsense writes rotations column by column.
        turned = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]]).ravel(order="F").tolist()
        width, height = SIZE
        for number in range(count):
            shade = np.full((height, width, 3), number, np.uint8)
            depth = np.tile(np.arange(4000, 4000 + width, dtype=np.uint16), (height, 1))
            self.queue.append(
                {
                    "color": FakeFrame(FakeProfile(model=self.model), number, shade),
                    "depth": FakeFrame(FakeProfile(), number, None if number == 2 else depth),
                    "accel": FakeFrame(
                        FakeProfile(turned), number, (9.8, 0, 0) if self.has_imu else None
                    ),
                    "gyro": FakeFrame(
                        FakeProfile(turned), number, (0, 0, 0) if self.has_imu else None
                    ),
                }
            )

    def config(self) -> Any:
        streams: list[tuple[Any, ...]] = []

        def can_resolve(_: Any) -> bool:
            modes = {stream[1:3] for stream in streams if len(stream) > 1}
            has_motion = any(stream[0] == "accel" for stream in streams)
            return modes == {SIZE} and (self.has_imu or not has_motion)

        return SimpleNamespace(
            streams=streams,
            enable_stream=lambda *stream: streams.append(stream),
            enable_device=lambda serial: None,
            can_resolve=can_resolve,
        )

    def pipeline_wrapper(self, pipeline: Any) -> Any:
        return pipeline

    def pipeline(self) -> FakeSdk:
        return self

    def start(self, config: Any) -> Any:
        if self.is_unplugged:
            raise RuntimeError("No device connected")
        self.is_running, self.config_used = True, config
        sensor = SimpleNamespace(get_depth_scale=lambda: 0.0005)
        device = SimpleNamespace(first_depth_sensor=lambda: sensor)
        return SimpleNamespace(get_device=lambda: device)

    def stop(self) -> None:
        self.is_running = False

    def try_wait_for_frames(self, timeout_ms: int) -> tuple[bool, Any]:
        if self.is_unplugged or not self.is_running:
            raise RuntimeError("wait_for_frames cannot be called before start()")
        if not self.queue:
            return False, None
        frames = self.queue.pop(0)
        return True, SimpleNamespace(
            first_or_default=lambda kind: frames[kind],
            get_color_frame=lambda: frames["color"],
            get_depth_frame=lambda: frames["depth"],
        )

    def align(self, stream: str) -> Any:
        assert stream == "color"
        return SimpleNamespace(process=lambda frames: frames)


@pytest.fixture
def sdk(monkeypatch: pytest.MonkeyPatch) -> FakeSdk:
    fake = FakeSdk()
    monkeypatch.setitem(sys.modules, "pyrealsense2", fake)  # type: ignore[arg-type]
    monkeypatch.setattr(device, "_FRAME_TIMEOUT_S", 0.05)
    return fake


def test_frames_have_metres_camera_time_and_gravity(sdk: FakeSdk) -> None:
    sdk.frames(5)
    source = open_realsense()
    frames = iter(source)
    seen = [next(frames) for _ in range(4)]
    assert source.is_live
    assert [frame.number for frame in seen] == [0, 1, 3, 4]
    assert source.counts == {"colour without depth": 1}
    for frame in seen:
        assert frame.camera == calib.PinholeCamera(*SIZE, 600.0, 601.0, 420.0, 240.0)
        assert frame.time_s == pytest.approx(1_700_000_000 + 0.033 * frame.number)
        assert frame.depth_m is not None
        assert frame.depth_m[0, :2].tolist() == pytest.approx([2.0, 2.0005])
        assert frame.image is not None
        assert frame.image[0, 0, 0] == frame.number
        np.testing.assert_allclose(frame.up_camera, [0, -1, 0], atol=1e-9)
    source.close()
    assert not sdk.is_running
    assert list(frames) == []


def test_a_camera_without_an_imu_uses_the_direction_that_is_given(sdk: FakeSdk) -> None:
    sdk.has_imu = False
    sdk.frames(1)
    source = open_realsense(up_camera=(0, -4, 3))
    np.testing.assert_allclose(next(iter(source)).up_camera, [0, -0.8, 0.6])
    assert {stream[0] for stream in sdk.config_used.streams} == {"color", "depth"}
    source.close()


def test_a_camera_that_is_missing_vanishes_or_falls_silent(sdk: FakeSdk) -> None:
    sdk.is_unplugged = True
    with pytest.raises(SourceLost, match=r"realsense cannot be opened \(No device connected\)"):
        open_realsense()
    sdk.is_unplugged = False
    source = open_realsense("123")
    with pytest.raises(SourceLost, match="realsense 123 sent no frames for"):
        next(iter(source))
    sdk.is_unplugged = True
    with pytest.raises(SourceLost, match="realsense 123 stopped"):
        next(iter(source))


def test_a_lens_model_without_a_formula_is_said(
    sdk: FakeSdk, caplog: pytest.LogCaptureFixture
) -> None:
    sdk.model = "distortion.inverse_brown_conrady"
    sdk.frames(2)
    frames = iter(open_realsense())
    assert next(frames).camera is None
    assert next(frames).camera is None
    assert caplog.text.count("calibrate the camera with a board") == 1


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyrealsense2", None)
    with pytest.raises(MissingPackage, match=r"pyrealsense2 is not installed.*\[realsense\]"):
        open_realsense()
