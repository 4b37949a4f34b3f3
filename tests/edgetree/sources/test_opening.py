"""What a source is follows from its text."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import pytest

from basetree.errors import InputError, MissingPackage
from calib import DepthScale
from edgetree.frames.rig import Rig
from edgetree.sources.live import open_live_source
from edgetree.sources.source import SourceLost

SCALE = DepthScale(1.1, 0.0, 0.001, 0.002, -0.9, 0.5, 4.0)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("0", 0),
        (" /dev/video2 ", 2),
        ("rtsp://camera/1", "rtsp://camera/1"),
        ("http://camera/video", "http://camera/video"),
    ],
)
def test_opencv_opens_devices_and_addresses(
    monkeypatch: pytest.MonkeyPatch, text: str, address: int | str
) -> None:
    asked: list[int | str] = []

    class NoCamera:
        def __init__(self, address: int | str, *_: object) -> None:
            asked.append(address)

        def isOpened(self) -> bool:
            return False

        def release(self) -> None:
            """There is nothing to release."""

    monkeypatch.setattr(cv2, "VideoCapture", NoCamera)
    with pytest.raises(SourceLost, match=f"camera {address} "):
        open_live_source(text)
    assert asked == [address]


def test_a_pipeline_is_for_gstreamer(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cv2.videoio_registry, "hasBackend", lambda _: False)
    with pytest.raises(InputError, match="GStreamer"):
        open_live_source("v4l2src ! appsink")


@pytest.mark.parametrize(
    ("text", "package"),
    [("realsense", "pyrealsense2"), ("oak", "depthai"), ("orbbec", "pyorbbecsdk")],
)
def test_the_cameras_of_makers_are_opened_by_their_packages(
    monkeypatch: pytest.MonkeyPatch, text: str, package: str
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingPackage, match=rf"{package}.*\[{text}\]"):
        open_live_source(text)


@pytest.mark.parametrize("kind", ["ros1", "mcap", "sqlite3"])
def test_recordings_are_recognised(write_bag: Callable[..., Path], kind: str) -> None:
    path = write_bag(kind)
    assert len(list(open_live_source(str(path)))) == 5
    if path.is_dir():
        (file,) = (part for part in path.iterdir() if part.suffix in (".mcap", ".db3"))
        assert len(list(open_live_source(str(file), modality="depth"))) == 5


def test_images_are_recognised_and_can_be_repeated(images: Path) -> None:
    frames = list(open_live_source(str(images), depth=images.parent / "depth"))
    assert [frame.depth_m is None for frame in frames] == [False, False]
    endless = iter(open_live_source(str(images), loop=True))
    seen = [next(endless) for _ in range(5)]
    assert [frame.number for frame in seen] == list(range(5))
    times = [frame.time_s for frame in seen]
    assert times == sorted(set(times))


def test_what_is_not_there_is_named() -> None:
    with pytest.raises(InputError, match=r"source nowhere does not exist: expected an image"):
        open_live_source("nowhere")
    pytest.importorskip("rosbags")
    with pytest.raises(InputError, match=r"recording nowhere.mcap does not exist: expected"):
        open_live_source("nowhere.mcap")


@pytest.mark.parametrize(
    ("text", "options", "expected"),
    [
        ("{images}", {"topics": {"colour": "/a"}}, "topics is given for source .*: expected it"),
        ("0", {"depth_scale_m": 0.1}, "for files, recordings and drives alone"),
        ("oak", {"rig": Rig(depth_scale_m=0.1)}, "for files, recordings and drives alone"),
        ("0", {"rig": Rig(depth_kind="range")}, "depth_kind is given for source 0: expected"),
        ("0", {"rig": Rig(depth_calibration=SCALE)}, "expected it for sources with depth"),
        ("{images}", {"scene": 1}, "for datasets of drives alone"),
        ("0", {"depth": Path("d")}, "depth is given for source 0: expected it for images alone"),
        ("0", {"loop": True}, "loop is given for source 0: expected it for files and recordings"),
    ],
)
def test_an_option_that_does_not_fit_is_named(
    images: Path, text: str, options: dict[str, Any], expected: str
) -> None:
    with pytest.raises(InputError, match=expected):
        open_live_source(text.format(images=images), **options)
