"""OAK cameras, against a fake of depthai 3 that follows its documentation."""

from __future__ import annotations

import sys
from datetime import timedelta
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import calib
from basetree.errors import MissingPackage
from edgetree.sources.cameras import device
from edgetree.sources.cameras.oak import open_oak
from edgetree.sources.source import SourceLost

WIDTH, HEIGHT = 1280, 720


class FakePort:
    """An input or output of a node; remembers what it is linked to."""

    def __init__(self, name: str, sdk: FakeSdk) -> None:
        self.name, self.sdk = name, sdk

    def link(self, other: FakePort) -> None:
        self.sdk.links.append((self.name, other.name))

    def createOutputQueue(self, maxSize: int, blocking: bool) -> FakeQueue:
        assert not blocking
        queue = FakeQueue(self.sdk)
        self.sdk.queues[self.name] = queue
        return queue


class FakeQueue:
    """A queue of the host."""

    def __init__(self, sdk: FakeSdk) -> None:
        self.sdk = sdk
        self.waiting: list[Any] = []

    def tryGet(self) -> Any:
        if self.sdk.is_unplugged:
            raise RuntimeError("MessageQueue was closed")
        return self.waiting.pop(0) if self.waiting else None

    def tryGetAll(self) -> list[Any]:
        waiting, self.waiting = self.waiting, []
        return waiting


class FakeNode:
    """A node: its ports appear when they are asked for, and its settings are taken."""

    def __init__(self, kind: str, sdk: FakeSdk) -> None:
        self.kind, self.sdk = kind, sdk
        self.inputs = _Inputs(self)

    def build(self, socket: str) -> FakeNode:
        self.kind = socket
        return self

    def requestOutput(self, **options: Any) -> FakePort:
        self.sdk.outputs[self.kind] = options
        return FakePort(self.kind, self.sdk)

    def __getattr__(self, name: str) -> Any:
        if name.startswith(("set", "enable")):
            return lambda *values: None
        return FakePort(f"{self.kind}.{name}", self.sdk)


class _Inputs:
    def __init__(self, node: FakeNode) -> None:
        self.node = node

    def __getitem__(self, name: str) -> FakePort:
        return FakePort(f"{self.node.kind}.{name}", self.node.sdk)


class FakeSdk:
    """The module depthai with one camera."""

    CameraBoardSocket = SimpleNamespace(CAM_A="CAM_A", CAM_B="CAM_B", CAM_C="CAM_C")
    Platform = SimpleNamespace(RVC2="RVC2", RVC4="RVC4")
    IMUSensor = SimpleNamespace(ACCELEROMETER_RAW=1, GYROSCOPE_RAW=2)
    ImgFrame = SimpleNamespace(Type=SimpleNamespace(BGR888i="BGR888i"))
    node = SimpleNamespace(
        Camera="Camera", StereoDepth="StereoDepth", Sync="Sync", ImageAlign="ImageAlign", IMU="IMU"
    )

    def __init__(self, platform: str = "RVC2") -> None:
        self.platform = platform
        self.imu = "BMI270"
        self.is_calibrated = True
        self.is_unplugged = self.is_running = False
        self.links: list[tuple[str, str]] = []
        self.outputs: dict[str, dict[str, Any]] = {}
        self.queues: dict[str, FakeQueue] = {}

    def Pipeline(self) -> FakeSdk:
        if self.is_unplugged:
            raise RuntimeError("No available devices")
        return self

    def create(self, kind: str) -> FakeNode:
        return FakeNode(kind, self)

    def start(self) -> None:
        self.is_running = True

    def stop(self) -> None:
        self.is_running = False

    def getDefaultDevice(self) -> FakeSdk:
        return self

    def getPlatform(self) -> str:
        return self.platform

    def getConnectedIMU(self) -> str:
        return self.imu

    def readCalibration(self) -> FakeSdk:
        return self

    def getImuToCameraExtrinsics(self, socket: str) -> list[list[float]]:
        if not self.is_calibrated:
            raise RuntimeError("IMU calibration data is not available on device yet.")
        # The IMU's x is up, where the camera's y is down.
        return [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]

    def send(self, number: int) -> None:
        """A pair of pictures and a packet of the IMU."""
        stamp = timedelta(seconds=1000 + 0.05 * number)
        transformation = SimpleNamespace(
            getIntrinsicMatrix=lambda: [[800.0, 0, 640], [0, 801.0, 360], [0, 0, 1]],
            getDistortionCoefficients=lambda: [0.0] * 14,
        )
        colour = SimpleNamespace(
            getCvFrame=lambda: np.full((HEIGHT, WIDTH, 3), number, np.uint8),
            getTransformation=lambda: transformation,
            getTimestamp=lambda: stamp,
            getSequenceNum=lambda: 40 + number,
        )
        row = np.linspace(2000, 6000, WIDTH).astype(np.uint16)
        depth = SimpleNamespace(getFrame=lambda: np.tile(row, (HEIGHT, 1)))
        self.queues["Sync.out"].waiting.append({"colour": colour, "depth": depth})
        if "IMU.out" in self.queues:
            push = SimpleNamespace(x=9.8, y=0.0, z=0.0, getTimestamp=lambda: stamp)
            turn = SimpleNamespace(x=0.0, y=0.0, z=0.0)
            packet = SimpleNamespace(acceleroMeter=push, gyroscope=turn)
            self.queues["IMU.out"].waiting.append(SimpleNamespace(packets=[packet]))


@pytest.fixture
def sdk(monkeypatch: pytest.MonkeyPatch) -> FakeSdk:
    fake = FakeSdk()
    monkeypatch.setitem(sys.modules, "depthai", fake)  # type: ignore[arg-type]
    monkeypatch.setattr(device, "_FRAME_TIMEOUT_S", 0.05)
    return fake


def test_frames_have_metres_camera_time_and_gravity(sdk: FakeSdk) -> None:
    source = open_oak()
    frames = iter(source)
    seen = []
    for number in (0, 1, 3):
        sdk.send(number)
        seen.append(next(frames))
    assert source.is_live
    assert [frame.number for frame in seen] == [0, 1, 3]
    np.testing.assert_allclose(np.diff([frame.time_s for frame in seen]), [0.05, 0.1], atol=1e-5)
    assert seen[0].time_s > 1000
    for frame in seen:
        assert frame.camera == calib.PinholeCamera(WIDTH, HEIGHT, 800.0, 801.0, 640.0, 360.0)
        assert frame.image is not None
        assert frame.image[0, 0, 0] == frame.number
        assert frame.depth_m is not None
        assert (frame.depth_m[0, 0], frame.depth_m[0, -1]) == (2, 6)
        np.testing.assert_allclose(frame.up_camera, [0, -1, 0], atol=1e-9)
    source.close()
    assert not sdk.is_running
    assert list(frames) == []


@pytest.mark.parametrize(
    ("platform", "expected"),
    [
        ("RVC2", {("CAM_A", "StereoDepth.inputAlignTo"), ("StereoDepth.depth", "Sync.depth")}),
        (
            "RVC4",
            {
                ("CAM_A", "ImageAlign.inputAlignTo"),
                ("StereoDepth.depth", "ImageAlign.input"),
                ("ImageAlign.outputAligned", "Sync.depth"),
            },
        ),
    ],
)
def test_depth_is_aligned_on_the_device(
    sdk: FakeSdk, platform: str, expected: set[tuple[str, str]]
) -> None:
    sdk.platform = platform
    open_oak().close()
    ends = {("CAM_A", "Sync.colour"), ("CAM_B", "StereoDepth.left"), ("CAM_C", "StereoDepth.right")}
    assert set(sdk.links) == expected | ends
    assert sdk.outputs["CAM_A"]["enableUndistortion"] is True


@pytest.mark.parametrize("lacking", ["imu", "calibration"])
def test_without_an_imu_the_direction_is_the_one_that_is_given(sdk: FakeSdk, lacking: str) -> None:
    sdk.imu, sdk.is_calibrated = ("NONE", True) if lacking == "imu" else ("BMI270", False)
    source = open_oak(up_camera=(0, -4, 3))
    sdk.send(0)
    np.testing.assert_allclose(next(iter(source)).up_camera, [0, -0.8, 0.6])
    source.close()


def test_a_camera_that_is_missing_vanishes_or_falls_silent(sdk: FakeSdk) -> None:
    sdk.is_unplugged = True
    with pytest.raises(SourceLost, match=r"oak cannot be opened \(No available devices\)"):
        open_oak()
    sdk.is_unplugged = False
    source = open_oak()
    with pytest.raises(SourceLost, match="oak sent no frames for"):
        next(iter(source))
    sdk.is_unplugged = True
    with pytest.raises(SourceLost, match="oak stopped"):
        next(iter(source))


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "depthai", None)
    with pytest.raises(MissingPackage, match=r"depthai is not installed.*\[oak\]"):
        open_oak()
