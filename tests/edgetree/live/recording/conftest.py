"""Frames to record, and what is in a recording."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame, stream_frame
from edgetree.frames.pipeline import FoundTrees
from edgetree.live.recording import FrameRecorder
from edgetree.live.results import LiveResult
from edgetree.sources import open_live_source

WIDTH, HEIGHT = 64, 48


def make_result(number: int, *, period_s: float = 0.1, **values: Any) -> LiveResult:
    """A result without trees; its picture cannot be compressed."""
    if not {"image", "depth_m"} & set(values):
        rng = np.random.default_rng(number)
        values["image"] = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    frame = stream_frame(number, 100 + number * period_s, **{"image": None, **values})
    pixels = frame.depth_m if frame.image is None else frame.image
    height, width = pixels.shape[:2]
    none = np.zeros((0, 4))
    trees = TreeDetections(none, none[:, 0], None, None, width, height)
    found = FoundTrees.detected(trees)
    return LiveResult(frame=frame, found=found, measurements=[], metres_need=None, tracks=[])


@pytest.fixture
def result() -> Callable[..., LiveResult]:
    return make_result


@pytest.fixture
def record(tmp_path: Path) -> Iterator[Callable[..., FrameRecorder]]:
    """A function that makes a recorder for the folder `recordings`."""
    pytest.importorskip("rosbags")
    made: list[FrameRecorder] = []

    def make(**settings: Any) -> FrameRecorder:
        made.append(FrameRecorder(tmp_path / "recordings", **settings))
        return made[-1]

    yield make
    for recorder in made:
        recorder.close()


@pytest.fixture
def recordings(tmp_path: Path) -> Callable[[], list[Path]]:
    """A function that returns the complete recordings, in their order."""
    folder = tmp_path / "recordings"
    return lambda: sorted(path for path in folder.glob("*") if "unfinished" not in path.name)


@pytest.fixture
def read() -> Callable[[Path], list[Frame]]:
    """A function that reads the frames of a recording as any user does."""
    return lambda path: list(open_live_source(str(path)))


@pytest.fixture
def said() -> Callable[[Path, str], list[dict[str, Any]]]:
    """A function that reads the JSON objects of a topic."""
    highlevel = pytest.importorskip("rosbags.highlevel")

    def objects(path: Path, topic: str) -> list[dict[str, Any]]:
        with highlevel.AnyReader([path]) as reader:
            connections = [one for one in reader.connections if one.topic == topic]
            return [
                json.loads(reader.deserialize(data, connection.msgtype).data)
                for connection, _, data in reader.messages(connections)
            ]

    return objects
