"""Cameras through OpenCV: the newest frame, a camera that vanishes, and a quick end."""

from __future__ import annotations

import itertools
import threading
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import cv2
import numpy as np
import pytest

import calib
from basetree.errors import InputError
from edgetree.sources.cameras import opencv as module
from edgetree.sources.cameras.opencv import open_camera
from edgetree.sources.source import SourceLost


class FakeCapture:
    """A camera of 64x48 px that sends a frame when it is told to, and the number as its shade."""

    opened: list[FakeCapture]

    def __init__(self, address: Any, *rest: Any) -> None:
        self.address, self.rest = address, rest
        self.frames = threading.Semaphore(0)
        self.sent = 0
        self.shape = (48, 64, 3)
        self.is_lost = self.is_released = False
        self.settings: dict[int, float] = {}
        FakeCapture.opened.append(self)

    def isOpened(self) -> bool:
        return self.address != "rtsp://nobody/1"

    def set(self, key: int, value: float) -> bool:
        self.settings[key] = value
        return True

    def read(self) -> tuple[bool, np.ndarray | None]:
        while not self.frames.acquire(timeout=0.05):
            if self.is_lost:
                return False, None
        self.sent += 1
        return True, np.full(self.shape, self.sent - 1, np.uint8)

    def send(self, count: int) -> None:
        target = self.sent + count
        self.frames.release(count)
        while self.sent < target:
            time.sleep(0.005)
        time.sleep(0.05)  # until the thread has kept it

    def release(self) -> None:
        self.is_released = True


@pytest.fixture
def fake(monkeypatch: pytest.MonkeyPatch) -> type[FakeCapture]:
    FakeCapture.opened = []
    monkeypatch.setattr(cv2, "VideoCapture", FakeCapture)
    return FakeCapture


def test_the_newest_frame_is_kept(fake: type[FakeCapture]) -> None:
    camera = calib.PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5)
    source = open_camera(0, camera=camera, up_camera=(0, -3, 0))
    (capture,) = fake.opened
    assert source.is_live
    assert capture.settings == {cv2.CAP_PROP_FRAME_WIDTH: 64, cv2.CAP_PROP_FRAME_HEIGHT: 48}
    capture.send(1)
    frames = iter(source)
    first = next(frames)
    capture.send(4)
    second = next(frames)
    assert (first.number, second.number) == (0, 4)
    assert second.image is not None
    assert second.image[0, 0, 0] == 4
    assert second.camera == camera
    np.testing.assert_array_equal(second.up_camera, [0, -1, 0])
    assert first.time_s < second.time_s <= time.time() + 0.01
    assert source.counts == {"replaced by newer frames": 3}
    capture.is_lost = True  # so that the reader ends at once
    source.close()


def test_a_camera_that_vanishes_is_said(fake: type[FakeCapture]) -> None:
    source = open_camera("rtsp://camera/1")
    fake.opened[0].is_lost = True
    with pytest.raises(SourceLost, match="camera rtsp://camera/1 sends no frames any more"):
        next(iter(source))
    source.close()
    assert fake.opened[0].is_released


def test_a_camera_that_hangs_is_said(
    fake: type[FakeCapture], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_FRAME_TIMEOUT_S", 0.1)
    source = open_camera(0)
    with pytest.raises(SourceLost, match="sends no frames"):
        next(iter(source))
    fake.opened[0].is_lost = True
    source.close()


def test_close_ends_a_waiting_iteration_within_a_second(fake: type[FakeCapture]) -> None:
    source = open_camera(0)
    found: list[Any] = []
    waiting = threading.Thread(target=lambda: found.extend(source))
    waiting.start()
    time.sleep(0.1)
    start = time.monotonic()
    source.close()  # the camera hangs and sends nothing
    waiting.join(1)
    assert not waiting.is_alive()
    assert time.monotonic() - start < 1
    assert found == []
    fake.opened[0].is_lost = True


def test_cameras_that_are_not_there_are_refused(fake: type[FakeCapture]) -> None:
    with pytest.raises(SourceLost, match="camera rtsp://nobody/1 cannot be opened: expected"):
        open_camera("rtsp://nobody/1")
    assert fake.opened[0].is_released


def test_a_pipeline_needs_gstreamer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: False)
    with pytest.raises(InputError, match="this OpenCV was built without GStreamer"):
        open_camera("videotestsrc ! appsink")


class MotionJpeg(BaseHTTPRequestHandler):
    """A network camera of 50 frames a second; the number of a frame is its shade."""

    is_off = threading.Event()

    def log_message(self, *_: Any) -> None:
        """Print nothing."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        with suppress(OSError):
            for number in itertools.count():
                if self.is_off.wait(0.02):
                    return
                jpeg = cv2.imencode(".jpg", np.full((48, 64, 3), number, np.uint8))[1].tobytes()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(head.encode() + jpeg + b"\r\n")


def test_a_network_camera_is_read_lost_and_opened_again() -> None:
    MotionJpeg.is_off.clear()
    server = ThreadingHTTPServer(("127.0.0.1", 0), MotionJpeg)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    port = server.server_address[1]
    address = f"http://user:secret@127.0.0.1:{port}/video"
    source = open_camera(address)
    assert source.name == f"camera http://127.0.0.1:{port}/video"  # without the password
    frames = iter(source)
    for _ in range(3):
        frame = next(frames)
        assert frame.image is not None
        assert frame.image[5, 5, 0] == frame.number
        time.sleep(0.1)
    assert source.counts["replaced by newer frames"] > 3
    MotionJpeg.is_off.set()
    with pytest.raises(SourceLost, match="sends no frames any more"):
        list(frames)
    source.close()
    MotionJpeg.is_off.clear()
    again = open_camera(address)
    assert next(iter(again)).number < 20
    again.close()
    MotionJpeg.is_off.set()
    server.shutdown()
    server.server_close()


def test_an_address_that_opencv_does_not_bear_is_refused() -> None:
    with pytest.raises(InputError, match="is no address: expected printable ASCII"):
        open_camera("rtsp://camera/\udcff")


def test_a_camera_of_another_aspect_ratio_is_named(fake: type[FakeCapture]) -> None:
    source = open_camera(0, camera=calib.PinholeCamera(64, 64, 60.0, 60.0, 31.5, 31.5))
    fake.opened[0].send(1)
    with pytest.raises(calib.CameraError, match="camera 0: the camera is for 64x64 px and the"):
        next(iter(source))
    fake.opened[0].is_lost = True
    source.close()


def test_pictures_that_change_their_shape_are_left_out(fake: type[FakeCapture]) -> None:
    source = open_camera(0, camera=calib.PinholeCamera(64, 48, 60.0, 60.0, 31.5, 23.5))
    frames, capture = iter(source), fake.opened[0]
    capture.send(1)
    assert next(frames).number == 0
    capture.shape = (64, 64, 3)
    capture.send(1)

    def fit_again() -> None:
        capture.shape = (48, 64, 3)
        capture.send(1)

    threading.Timer(0.3, fit_again).start()
    assert next(frames).number == 2
    assert source.counts["pictures of another shape than the camera file"] == 1
    capture.is_lost = True
    source.close()
