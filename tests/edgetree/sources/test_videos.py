"""Videos: every kind that OpenCV reads, under any name, whole or not."""

from __future__ import annotations

import json
import logging
import re
import shutil
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.sources import open_files, open_source
from edgetree.sources.source import INCOMPLETE

CODECS = {".avi": "MJPG", ".mkv": "MJPG", ".mp4": "mp4v", ".mov": "mp4v", ".ts": "mp4v"}
FRAMES = 30


def picture(number: int) -> np.ndarray:
    pixels = np.random.default_rng(number).integers(0, 256, (48, 64, 3), np.uint8)
    pixels[:, : 2 * number] = 40
    return pixels


def write(path: Path, frames: int = FRAMES) -> Path:
    code = cv2.VideoWriter.fourcc(*CODECS[path.suffix])
    writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, code, 10, (64, 48))
    assert writer.isOpened()
    for number in range(frames):
        writer.write(picture(number))
    writer.release()
    return path


def write_by_av(path: Path, steps_ms: list[int], codec: str, form: str | None = None) -> Path:
    """A video whose frames are so many milliseconds apart."""
    av = pytest.importorskip("av")
    with av.open(str(path), "w", format=form) as container:
        stream = container.add_stream(codec, rate=10)
        stream.width, stream.height = 64, 48
        stream.pix_fmt = "yuvj420p" if codec == "mjpeg" else "yuv420p"
        stream.time_base = stream.codec_context.time_base = Fraction(1, 1000)
        for number, time_ms in enumerate(np.cumsum(steps_ms)):
            frame = av.VideoFrame.from_ndarray(picture(number % 30), "bgr24")
            frame = frame.reformat(format=stream.pix_fmt)
            frame.pts, frame.time_base = int(time_ms), Fraction(1, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.mark.parametrize("suffix", CODECS)
@pytest.mark.parametrize("share", [0.4, 0.7])
def test_a_video_that_is_cut_off_says_so(
    tmp_path: Path, suffix: str, share: float, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path / f"drive{suffix}")
    assert not any(open_source(path).counts.values())
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share) // 188 * 188 + 100])
    if suffix in (".mp4", ".mov"):
        with pytest.raises(InputError, match=r"as it has \d+ of the \d+ bytes that it states: exp"):
            open_source(path)
        return
    source = open_source(path)
    frames = list(source)
    assert 3 < len(frames) < FRAMES
    assert source.counts["ended early"] == 1
    assert f"the video ended after {len(frames)}" in caplog.text
    if suffix != ".ts":
        assert f"after {len(frames)} of {FRAMES} frames" in caplog.text
    live = open_files(path)
    assert len(list(live)) == len(frames)
    assert live.counts["ended early"] == 1


@pytest.mark.parametrize("suffix", CODECS)
def test_a_whole_video_raises_no_alarm(
    tmp_path: Path, suffix: str, caplog: pytest.LogCaptureFixture
) -> None:
    source = open_source(write(tmp_path / f"drive{suffix}"))
    assert len(list(source)) == FRAMES
    assert not any(source.counts[name] for name in INCOMPLETE)
    assert caplog.records == []


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("a.mp4", "libx264"),
        ("a.mkv", "libx264"),
        ("a.mkv", "mjpeg"),
        ("a.ts", "libx264"),
        ("a.avi", "mpeg4"),
        ("a.webm", "libvpx-vp9"),
        ("a.flv", "flv1"),
        ("a.wmv", "wmv2"),
    ],
)
def test_a_whole_video_of_variable_rate_raises_no_alarm(
    tmp_path: Path, name: str, codec: str, caplog: pytest.LogCaptureFixture
) -> None:
    steps_ms = np.random.default_rng(1).integers(20, 500, FRAMES).tolist()
    source = open_source(write_by_av(tmp_path / name, steps_ms, codec))
    frames = list(source)
    assert len(frames) == FRAMES
    assert not any(source.counts[each] for each in INCOMPLETE)
    assert [each for each in caplog.records if each.levelno >= logging.WARNING] == []
    times = [frame.time_s for frame in frames]
    assert times == sorted(set(times))


@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".ts"])
def test_frames_after_a_broken_part_are_read_and_the_part_is_told(
    tmp_path: Path, suffix: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = write(tmp_path / f"drive{suffix}")
    data = bytearray(path.read_bytes())
    half, tenth = len(data) // 2, len(data) // 10
    data[half : half + tenth] = np.random.default_rng(3).integers(0, 256, tenth, np.uint8).tobytes()
    path.write_bytes(data)
    source = open_source(path)
    frames = list(source)
    assert FRAMES // 2 < len(frames) < FRAMES
    assert source.counts["broken video frames"] > 0
    assert f"broken in its middle: {path}: {len(frames)} of 30 frames" in caplog.text


@pytest.mark.skipif("sys.platform == 'win32'", reason="names that Windows does not have")
@pytest.mark.parametrize(
    "name",
    ["10:30:00.mp4", "file:a.mp4", "http:a.mp4", "-a.mp4", "a%03d.mp4", "a[1-3].mp4", "a b.mp4"],
)
def test_a_name_is_a_name(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "plain.mp4").rename(tmp_path / name)
    for number in (1, 2, 3):
        shutil.copy(tmp_path / name, tmp_path / f"a{number:03d}.mp4")
    monkeypatch.chdir(tmp_path)
    for path in (Path(name), Path(".") / name, tmp_path / name):
        assert len(list(open_source(path))) == FRAMES


@pytest.mark.parametrize("suffix", [".TS", ".m2ts", ".MTS", ".3gp", ".qt", ".video", ""])
def test_a_video_is_told_by_its_content(tmp_path: Path, suffix: str) -> None:
    written = write(tmp_path / ("a.mp4" if suffix in (".3gp", ".qt") else "a.ts"))
    path = written.rename(tmp_path / f"drive{suffix}")
    assert len(list(open_source(path))) == FRAMES


@pytest.mark.parametrize(("suffix", "codec", "form"), [(".h264", "libx264", "h264")])
def test_a_stream_without_time_stamps_has_rising_times(
    tmp_path: Path, suffix: str, codec: str, form: str
) -> None:
    path = write_by_av(tmp_path / f"a{suffix}", [100] * FRAMES, codec, form)
    times = [frame.time_s for frame in open_source(path)]
    assert len(times) == FRAMES
    assert times == sorted(set(times))


@pytest.mark.parametrize("suffix", [".txt", ".ts", ".mkv", ".dat", ".nfo", ""])
def test_text_and_noise_are_no_videos(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    for content in (b"export const a = 1;\n" * 50, bytes(range(256)) * 40, b""):
        path.write_bytes(content)
        with pytest.raises(InputError, match=r"a.*(cannot be read|has no frame).*: expected"):
            open_source(path)


def test_run_and_live_end_with_exit_code_1(
    tmp_path: Path, model: Path, run_cli: Callable[..., Any]
) -> None:
    path = write(tmp_path / "drive.mkv")
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    for command in ("run", "live"):
        done = run_cli(command, path, "--model", model)
        assert done.code == 1, done.err
        lines = len(done.out.splitlines())
        assert 3 < lines < FRAMES
        assert f"the video ended after {lines} of {FRAMES} frames: " in done.err
        assert done.err.splitlines()[-1].startswith(f"edgetree: {path} is not complete")
    shards = ("--shards", tmp_path / "parts", "--jsonl", tmp_path / "a.jsonl")
    done = run_cli("run", path, "--model", model, *shards)
    assert done.code == 1
    assert f"left out: {path}: 1 ended early" in done.err


@pytest.mark.parametrize(
    "text", ["ffconcat version 1.0\nfile other.mp4\n", "#EXTM3U\n#EXTINF:1,\nother.mp4\n"]
)
def test_a_text_that_names_other_files_is_no_video(tmp_path: Path, text: str) -> None:
    write(tmp_path / "other.mp4")
    path = tmp_path / "list.mp4"
    path.write_text(text)
    with pytest.raises(InputError, match=r"list\.mp4 cannot be read"):
        open_source(path)


def test_a_recording_that_cannot_be_opened_leaves_the_others_of_a_job(
    tmp_path: Path, model: Path, run_cli: Callable[..., Any]
) -> None:
    folder = tmp_path / "drives"
    folder.mkdir()
    write(folder / "a.mp4")
    (folder / "b.mp4").write_bytes(b"no video" * 50)
    write(folder / "c.mp4")
    lines = tmp_path / "a.jsonl"
    outputs = ("--shards", tmp_path / "parts", "--jsonl", lines, "--csv", tmp_path / "a.csv")
    done = run_cli("run", folder, "--model", model, *outputs)
    assert done.code == 1
    assert re.search(rf"left out: .*{re.escape(str(folder / 'b.mp4'))} cannot be read", done.err)
    paths = [json.loads(line)["path"] for line in lines.read_text().splitlines()]
    assert [Path(each).stem[0] for each in paths] == ["a"] * FRAMES + ["c"] * FRAMES
