"""Fixtures of the board tests: synthetic images of boards."""

from collections.abc import Callable
from functools import cache

import fake_boards as fake
import pytest

from calib.boards import BoardDetections, Picture, find_boards


@pytest.fixture(scope="session")
def pictures() -> Callable[[str, str], list[Picture]]:
    """Render 14 images of a board of ``fake_boards.BOARDS`` with a distortion model."""

    @cache
    def make(board: str, model: str) -> list[Picture]:
        camera = fake.TRUTH[model]
        images = fake.rendered(camera, fake.BOARDS[board], fake.poses(camera, 14, seed=2))
        return [Picture(f"picture{i}", image) for i, image in enumerate(images)]

    return make


@pytest.fixture(scope="session")
def seen(
    pictures: Callable[[str, str], list[Picture]],
) -> Callable[[str, str], BoardDetections]:
    """Detect the boards in these images."""

    @cache
    def find(board: str, model: str) -> BoardDetections:
        return find_boards(pictures(board, model), fake.BOARDS[board])

    return find
