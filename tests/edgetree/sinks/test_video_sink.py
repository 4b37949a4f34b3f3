"""Videos with the trees drawn."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, FrameResult
from edgetree.sinks import VideoSink
from edgetree.sinks.video import CODECS


def result(number: int, size: tuple[int, int] = (64, 48), rate_hz: float = 25.0) -> FrameResult:
    width, height = size
    frame = Frame(
        f"{number}",
        None,
        np.full((height, width, 3), 10 * number, np.uint8),
        time_s=number / rate_hz,
    )
    box = np.array([[20, 2, 40, 40]], np.float32)
    trees = TreeDetections(box, np.ones(1, np.float32), None, None, width, height)
    return FrameResult(frame, FoundTrees.detected(trees), None, "need depth")


def read(path: Path) -> tuple[list[np.ndarray], float]:
    video = cv2.VideoCapture(str(path))
    frames = []
    while (found := video.read())[0]:
        frames.append(found[1])
    rate_hz = video.get(cv2.CAP_PROP_FPS)
    video.release()
    return frames, rate_hz


@pytest.mark.parametrize("suffix", sorted(CODECS))
def test_every_frame_is_drawn_at_the_source_s_rate(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"drawn{suffix}"
    with VideoSink(path, 25.0) as sink:
        for number in range(12):
            sink.write(result(number))
        assert not path.exists()
    frames, rate_hz = read(path)
    assert len(frames) == 12
    assert rate_hz == pytest.approx(25, abs=0.1)
    assert frames[6].std() > 5  # the box
    assert [each.name for each in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("count", [3, 15])
def test_the_rate_follows_from_time_stamps(tmp_path: Path, count: int) -> None:
    with VideoSink(tmp_path / "a.avi") as sink:
        for number in range(count):
            sink.write(result(number, rate_hz=8.0))
    frames, rate_hz = read(tmp_path / "a.avi")
    assert (len(frames), rate_hz) == (count, pytest.approx(8.0))


def test_pictures_of_odd_sizes_lose_nothing(tmp_path: Path) -> None:
    with VideoSink(tmp_path / "a.mp4", 10.0) as sink:
        sink.write(result(1, (65, 47)))
    [frame], _ = read(tmp_path / "a.mp4")
    assert frame.shape == (48, 66, 3)


def test_a_frame_of_another_size_ends_the_video_with_one_line(tmp_path: Path) -> None:
    sink = VideoSink(tmp_path / "a.mp4", 10.0)
    sink.write(result(0))
    told = r"a\.mp4: a frame is 32x48 px: expected 64x48 px"
    with pytest.raises(InputError, match=told), sink:
        sink.write(result(1, (32, 48)))
    assert not list(tmp_path.iterdir())


def test_a_codec_that_is_missing_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CODECS, ".mp4", "XXXX")
    with (
        pytest.raises(InputError, match=r"no codec XXXX for \.mp4 files.*such as \.avi"),
        VideoSink(tmp_path / "a.mp4", 10.0) as sink,
    ):
        sink.write(result(0))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.y4m", "a.gif", "a"])
def test_names_that_no_codec_fits_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"ends in \.avi, "):
        VideoSink(tmp_path / name)
