"""Fixtures that write small recordings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import bag_files
import pytest


@pytest.fixture(scope="session")
def bags() -> Any:
    """The helper module `bag_files`."""
    pytest.importorskip("rosbags")
    return bag_files


@pytest.fixture
def write_bag(bags: Any, tmp_path: Path) -> Callable[..., Path]:
    """A function that writes frames of colour and depth with their camera, and returns the path."""

    def write(
        kind: str = "mcap",
        frames: int = 5,
        *,
        depth_delay_ns: int = 1_000_000,
        name: str = "drive",
        **topics: bool,
    ) -> Path:
        with bags.BagFile(tmp_path, kind, name) as bag:
            for number in range(frames):
                frame = bags.small_frame(number)
                stamp = bags.START_NS + number * bags.PERIOD_NS
                if topics.get("colour", True):
                    bag.image(bags.COLOUR, frame.image, stamp)
                if topics.get("depth", True):
                    bag.image(bags.DEPTH, frame.depth, stamp + depth_delay_ns, "16UC1")
                if topics.get("info", True):
                    bag.info(bags.INFO, frame.camera, stamp)
        return bag.path

    return write
