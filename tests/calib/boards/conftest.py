"""Fixtures of the board tests: synthetic images of boards."""

import importlib.util
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

from calib.boards import BoardDetections, Picture, find_boards


@pytest.fixture(scope="session")
def fake() -> ModuleType:
    """The module ``fake_boards``."""
    spec = importlib.util.spec_from_file_location(
        "fake_boards", Path(__file__).with_name("fake_boards.py")
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def pictures(fake: ModuleType) -> Callable[[str, str], list[Picture]]:
    """Render 14 images of a board of ``fake_boards.BOARDS`` with a distortion model."""

    @cache
    def make(board: str, model: str) -> list[Picture]:
        camera = fake.TRUTH[model]
        images = fake.rendered(camera, fake.BOARDS[board], fake.poses(camera, 14, seed=2))
        return [Picture(f"picture{i}", image) for i, image in enumerate(images)]

    return make


@pytest.fixture(scope="session")
def seen(
    fake: ModuleType, pictures: Callable[[str, str], list[Picture]]
) -> Callable[[str, str], BoardDetections]:
    """Detect the boards in these images."""

    @cache
    def find(board: str, model: str) -> BoardDetections:
        return find_boards(pictures(board, model), fake.BOARDS[board])

    return find
