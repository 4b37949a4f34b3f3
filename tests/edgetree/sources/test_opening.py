"""What a source is follows from its text."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError
from edgetree.sources import live as opening
from edgetree.sources.live import open_live_source


@pytest.mark.parametrize(
    ("text", "opener", "address"),
    [
        ("0", "open_camera", 0),
        ("/dev/video2", "open_camera", 2),
        ("rtsp://camera/1", "open_camera", "rtsp://camera/1"),
        ("http://camera/video", "open_camera", "http://camera/video"),
        ("v4l2src ! appsink", "open_camera", "v4l2src ! appsink"),
        ("realsense", "realsense", None),
        ("oak", "oak", None),
        ("orbbec", "orbbec", None),
    ],
)
def test_cameras_are_recognised(
    monkeypatch: pytest.MonkeyPatch, text: str, opener: str, address: Any
) -> None:
    calls: list[tuple[Any, ...]] = []

    def note(called: str) -> Callable[..., None]:
        return lambda *given, **_: calls.append((called, *given))

    monkeypatch.setattr(opening, "open_camera", note("open_camera"))
    monkeypatch.setattr(opening, "_VENDORS", {name: note(name) for name in opening._VENDORS})
    open_live_source(text)
    assert calls == [(opener,) if address is None else (opener, address)]


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
        ("{images}", {"depth_scale_m": 0.1}, "for recordings alone"),
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
