"""Orbbec cameras, against a fake of pyorbbecsdk that follows its documentation."""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import MissingPackage
from edgetree.sources.cameras import device
from edgetree.sources.cameras.orbbec import open_orbbec
from edgetree.sources.source import SourceLost

WIDTH, HEIGHT = 64, 48


class OBError(Exception):
    """The error of the SDK."""


class FakeFrame:
    """A picture or a reading of the accelerometer."""

    def __init__(self, number: int, form: str, data: Any, profile: Any) -> None:
        self.number, self.form, self.data, self.profile = number, form, data, profile

    def get_index(self) -> int:
        return 70 + self.number

    def get_system_timestamp_us(self) -> int:
        return 1_700_000_000_000_000 + 33_000 * self.number

    def get_format(self) -> str:
        return self.form

    def get_width(self) -> int:
        return WIDTH

    def get_height(self) -> int:
        return HEIGHT

    def get_data(self) -> Any:
        return np.frombuffer(self.data, np.uint8)

    def get_depth_scale(self) -> float:
        return 0.5  # mm

    def get_stream_profile(self) -> Any:
        return self.profile

    def as_accel_frame(self) -> FakeFrame:
        return self

    def get_x(self) -> float:
        return 9.8

    def get_y(self) -> float:
        return 0.0

    def get_z(self) -> float:
        return 0.0


class FakePipeline:
    """The pipeline of the pictures or, with a device, of the accelerometer."""

    def __init__(self, sdk: FakeSdk, own: Any = None) -> None:
        if sdk.is_unplugged:
            raise OBError("No device found")
        self.sdk, self.own = sdk, own
        self.is_running = False
        sdk.pipelines.append(self)

    def get_device(self) -> FakeSdk:
        return self.sdk

    def get_stream_profile_list(self, sensor: str) -> Any:
        return SimpleNamespace(get_default_video_stream_profile=lambda: self.sdk.profile)

    def enable_frame_sync(self) -> None:
        raise OBError("frame sync is not supported")

    def start(self, config: Any, callback: Callable[[Any], None] | None = None) -> None:
        self.is_running = True
        self.callback = callback

    def stop(self) -> None:
        self.is_running = False

    def wait_for_frames(self, timeout_ms: int) -> Any:
        if self.sdk.is_unplugged:
            raise OBError("device disconnected")
        return self.sdk.queue.pop(0) if self.sdk.queue else None


class FakeSdk:
    """The module pyorbbecsdk with one camera."""

    OBError = OBError
    OBSensorType = SimpleNamespace(COLOR_SENSOR="color", DEPTH_SENSOR="depth", ACCEL_SENSOR="accel")
    OBStreamType = SimpleNamespace(COLOR_STREAM="color")
    OBFrameType = SimpleNamespace(ACCEL_FRAME="accel")
    OBFrameAggregateOutputMode = SimpleNamespace(FULL_FRAME_REQUIRE="all")
    OBFormat = SimpleNamespace(MJPG="MJPG", RGB="RGB", BGR="BGR", YUYV="YUYV", UYVY="UYVY")

    def __init__(self) -> None:
        self.is_unplugged = False
        self.has_accel = True
        self.model, self.k1 = "BROWN_CONRADY_K6", 0.0
        self.pipelines: list[FakePipeline] = []
        self.queue: list[Any] = []
        # The accelerometer's x is up, where the camera's y is down. Rotations are row by row.
        extrinsic = SimpleNamespace(rot=[0, 1, 0, -1, 0, 0, 0, 0, 1], transform=[0, 0, 0])
        terms = dict.fromkeys(("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"), 0.0)
        self.profile = SimpleNamespace(
            get_intrinsic=lambda: SimpleNamespace(
                width=WIDTH, height=HEIGHT, fx=60.0, fy=61.0, cx=32.0, cy=24.0
            ),
            get_distortion=lambda: SimpleNamespace(
                **terms | {"k1": self.k1}, model=SimpleNamespace(name=self.model)
            ),
            get_extrinsic_to=lambda other: extrinsic,
        )

    def Pipeline(self, own: Any = None) -> FakePipeline:
        return FakePipeline(self, own)

    def Config(self) -> Any:
        return SimpleNamespace(
            enable_stream=lambda profile: None,
            enable_accel_stream=lambda: None,
            set_frame_aggregate_output_mode=lambda mode: None,
        )

    def AlignFilter(self, align_to_stream: str) -> Any:
        assert align_to_stream == "color"
        return SimpleNamespace(process=lambda frames: frames)

    def get_sensor(self, sensor: str) -> Any:
        if not self.has_accel:
            raise OBError("Unsupported sensor type")
        return sensor

    def send(self, number: int, form: str = "RGB", *, has_depth: bool = True) -> None:
        bgr = np.zeros((HEIGHT, WIDTH, 3), np.uint8) + np.array([10, 20, 30], np.uint8)
        data = {
            "RGB": bgr[..., ::-1].tobytes(),
            "BGR": bgr.tobytes(),
            "MJPG": cv2.imencode(".jpg", bgr)[1].tobytes(),
            "broken MJPG": b"no jpeg",
            "Y16": b"",
        }[form]
        row = np.linspace(4000, 12000, WIDTH).astype(np.uint16)
        depth = np.tile(row, (HEIGHT, 1)).tobytes()
        if self.has_accel:
            accel = FakeFrame(number, "", None, self.profile)
            callback = self.pipelines[-1].callback
            assert callback is not None
            callback(SimpleNamespace(get_frame=lambda kind: accel))
        colour = FakeFrame(number, form.rpartition(" ")[2], data, self.profile)
        frames = SimpleNamespace(
            get_color_frame=lambda: colour,
            get_depth_frame=lambda: (
                FakeFrame(number, "Y16", depth, self.profile) if has_depth else None
            ),
        )
        frames.as_frame_set = lambda: frames
        self.queue.append(frames)


@pytest.fixture
def sdk(monkeypatch: pytest.MonkeyPatch) -> FakeSdk:
    fake = FakeSdk()
    monkeypatch.setitem(sys.modules, "pyorbbecsdk", fake)  # type: ignore[arg-type]
    monkeypatch.setattr(device, "_FRAME_TIMEOUT_S", 0.05)
    return fake


def test_frames_have_metres_camera_time_and_gravity(sdk: FakeSdk) -> None:
    source = open_orbbec()
    for number, form in enumerate(("RGB", "BGR", "MJPG", "broken MJPG", "RGB")):
        sdk.send(number, form)
    sdk.send(5, has_depth=False)
    sdk.send(6)
    frames = iter(source)
    seen = [next(frames) for _ in range(5)]
    assert source.is_live
    assert [frame.number for frame in seen] == [0, 1, 2, 4, 6]
    assert source.counts == {"unreadable images": 1, "colour without depth": 1}
    for frame in seen:
        assert frame.camera == calib.PinholeCamera(WIDTH, HEIGHT, 60.0, 61.0, 32.0, 24.0)
        assert frame.time_s == pytest.approx(1_700_000_000 + 0.033 * frame.number)
        assert frame.depth_m is not None
        assert (frame.depth_m[0, 0], frame.depth_m[0, -1]) == (2, 6)
        assert frame.image is not None
        np.testing.assert_allclose(frame.image[5, 5].astype(int), [10, 20, 30], atol=3)
        np.testing.assert_allclose(frame.up_camera, [0, -1, 0], atol=1e-9)
    source.close()
    assert [pipeline.is_running for pipeline in sdk.pipelines] == [False, False]
    assert list(frames) == []


def test_without_an_accelerometer_the_direction_is_the_one_that_is_given(sdk: FakeSdk) -> None:
    sdk.has_accel = False
    source = open_orbbec(up_camera=(0, -4, 3))
    sdk.send(0)
    np.testing.assert_allclose(next(iter(source)).up_camera, [0, -0.8, 0.6])
    source.close()


def test_a_lens_model_without_a_formula_is_said(
    sdk: FakeSdk, caplog: pytest.LogCaptureFixture
) -> None:
    sdk.model, sdk.k1 = "INVERSE_BROWN_CONRADY", 0.1
    source = open_orbbec()
    sdk.send(0)
    assert next(iter(source)).camera is None
    assert "its lens model is INVERSE_BROWN_CONRADY, expected Brown Conrady" in caplog.text
    sdk.model = "BROWN_CONRADY"
    source = open_orbbec()
    sdk.send(1)
    camera = next(iter(source)).camera
    assert camera is not None
    assert camera.distortion[0] == 0.1


def test_a_camera_that_is_missing_vanishes_or_falls_silent(sdk: FakeSdk) -> None:
    sdk.is_unplugged = True
    with pytest.raises(SourceLost, match=r"orbbec cannot be opened \(No device found\)"):
        open_orbbec()
    sdk.is_unplugged = False
    source = open_orbbec()
    with pytest.raises(SourceLost, match="orbbec sent no frames for"):
        next(iter(source))
    sdk.send(0, "Y16")
    with pytest.raises(SourceLost, match="its colour is Y16, expected MJPG, RGB"):
        next(iter(source))
    sdk.is_unplugged = True
    with pytest.raises(SourceLost, match="orbbec stopped"):
        next(iter(source))


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyorbbecsdk", None)
    with pytest.raises(MissingPackage, match=r"pyorbbecsdk2 is not installed.*\[orbbec\]"):
        open_orbbec()
