"""Stereo pairs in recordings: topics that belong together by their time, `run` and `live`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import phone_captures
import pytest
from textured_pair import bent_pair, pictures

from basetree.errors import InputError
from calib.files.stereo import save_stereo
from edgetree.sources.stereo import open_stereo_recording

Cli = Callable[..., Any]
LEFT, RIGHT = "/left/image_raw", "/right/image_raw"
TOPICS = {"colour": LEFT, "right": RIGHT}
OPTIONS = ("--topic", f"colour={LEFT}", "--topic", f"right={RIGHT}", "--camera", "pair.json")
UP = ",".join(map(str, phone_captures.mounting(0).rotation[2]))


@pytest.fixture
def write_pair(bags: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """A function that records two cameras and their calibration, in a folder that it changes to."""
    monkeypatch.chdir(tmp_path)
    left, right = pictures(bent_pair())

    def write(frames: int = 3, delay_ns: int = 0, missing: tuple[int, ...] = ()) -> Path:
        save_stereo(tmp_path / "pair.json", bent_pair())
        with bags.BagFile(tmp_path, "mcap", "walk") as bag:
            for number in range(frames):
                stamp = bags.START_NS + number * bags.PERIOD_NS
                bag.image(LEFT, left, stamp)
                if number not in missing:
                    bag.image(RIGHT, right, stamp + delay_ns)
        return Path(bag.path)

    return write


def test_the_pictures_of_one_moment_give_depth(write_pair: Callable[..., Path]) -> None:
    pair = bent_pair()
    source = open_stereo_recording(write_pair(), pair, topics=TOPICS)
    frames = list(source)
    assert [frame.number for frame in frames] == [0, 1, 2]
    assert not source.counts
    expected = pair.rectified.depth(*pictures(pair))
    for frame in frames:
        assert frame.camera == pair.rectified.camera
        assert frame.depth_noise is not None
        np.testing.assert_array_equal(frame.depth_m, expected.depth_m)


def test_a_picture_without_a_partner_is_left_out(write_pair: Callable[..., Path]) -> None:
    source = open_stereo_recording(write_pair(5, missing=(1, 2)), bent_pair(), topics=TOPICS)
    assert [frame.number for frame in source] == [0, 3, 4]
    assert source.counts == {"left pictures without a right one": 2}


def test_a_recording_without_its_end_is_said(write_pair: Callable[..., Path]) -> None:
    path = write_pair(6)
    (file,) = [path] if path.is_file() else path.glob("*.mcap")
    content = file.read_bytes()
    file.write_bytes(content[: len(content) * 9 // 10])
    source = open_stereo_recording(file, bent_pair(), topics=TOPICS)
    assert 0 < len(list(source)) < 6
    assert source.counts["end missing"] == 1


def test_pictures_of_other_moments_are_no_pairs(write_pair: Callable[..., Path], bags: Any) -> None:
    path = write_pair(2, delay_ns=10 * bags.PERIOD_NS)
    source = open_stereo_recording(path, bent_pair(), topics=TOPICS)
    with pytest.raises(InputError, match="no left and right picture are of the same moment"):
        list(source)


@pytest.mark.parametrize("command", ["run", "live"])
def test_the_commands_take_pairs(
    run_cli: Cli, write_pair: Callable[..., Path], command: str
) -> None:
    done = run_cli(command, write_pair(), *OPTIONS, "--up", UP, "--jsonl", "trees.jsonl")
    assert done.code == 0, done.err
    lines = [json.loads(line) for line in Path("trees.jsonl").read_text().splitlines()]
    assert len(lines) == 3
    assert "depth" in done.err


@pytest.mark.parametrize("command", ["run", "live"])
def test_without_a_calibration_it_is_said(
    run_cli: Cli, write_pair: Callable[..., Path], command: str
) -> None:
    done = run_cli(command, write_pair(), *OPTIONS[:4])
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "--topic right given without --camera: expected the calibration" in done.err


@pytest.mark.parametrize("command", ["run", "live"])
def test_two_cameras_need_their_names(
    run_cli: Cli, write_pair: Callable[..., Path], command: str
) -> None:
    done = run_cli(command, write_pair(), *OPTIONS[2:])
    assert (done.code, done.err.count("\n")) == (2, 1)
    assert "colour" in done.err
    assert LEFT in done.err
