"""Detect a board in images, without repeated views."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from basetree.arrays import UInt8
from basetree.errors import InputError
from calib.boards.board import Board
from calib.boards.solve import BoardView

_THUMBNAIL: Final = (32, 24)
_MIN_GREY_CHANGE = 0.5
_MIN_MOTION_SHARE = 0.01
_MIN_INTERVAL_S = 0.2
_MOST_PARTS = 5  # images that are looked at again for what is seen of the board


@dataclass(frozen=True, eq=False)
class Picture:
    """A grey image.

    Attributes:
        name: Name for messages.
        grey: (H, W) uint8.
        time_s: Time in the video in seconds; None for a still image.
    """

    name: str
    grey: UInt8
    time_s: float | None = None


@dataclass(frozen=True)
class BoardDetections:
    """Detections of a board in images of one size.

    Attributes:
        views: Detected points of the board, one entry per distinct view.
        width: Width of the images in px; 0 if there were none.
        height: Height of the images in px; 0 if there were none.
        pictures: Number of images searched. Video frames that follow too soon or look like the one
            before are skipped and not counted.
        without_board: Names of the images in which no board was found.
        repeated: Names of the images that show the board as an earlier one does.
        seen_in_part: What is seen of the board in some of the images without it, by their names.
    """

    views: tuple[BoardView, ...]
    width: int
    height: int
    pictures: int
    without_board: tuple[str, ...]
    repeated: tuple[str, ...]
    seen_in_part: Mapping[str, str] = field(default_factory=dict)


def find_boards(pictures: Iterable[Picture], board: Board) -> BoardDetections:
    """Detect a board in images.

    Args:
        pictures: Images of one size, stills or video frames in order of time.
        board: The board to find.

    Returns:
        The distinct views, and the names of images without a board or with a repeated view.

    Raises:
        InputError: If an image has another size than the first.
    """
    first: Picture | None = None
    views: list[BoardView] = []
    without_board: list[str] = []
    repeated: list[str] = []
    parts: dict[str, str] = {}
    searched = 0
    for picture in _sampled(pictures):
        first = first or picture
        if picture.grey.shape != first.grey.shape:
            raise InputError(
                f"{picture.name} is {_size_text(picture)}: expected {_size_text(first)},"
                f" as {first.name}; all images must have one size"
            )
        searched += 1
        found = board.detect(picture.grey)
        if found is None:
            without_board.append(picture.name)
            if len(parts) < _MOST_PARTS and (part := board.seen_in_part(picture.grey)):
                parts[picture.name] = part
            continue
        view = BoardView(picture.name, *found)
        if any(_same_view(view, other, max(picture.grey.shape)) for other in views):
            repeated.append(view.name)
        else:
            views.append(view)
    height, width = (0, 0) if first is None else first.grey.shape
    return BoardDetections(
        tuple(views), width, height, searched, tuple(without_board), tuple(repeated), parts
    )


def _sampled(pictures: Iterable[Picture]) -> Iterable[Picture]:
    """Skip video frames that follow too soon or look like the one before."""
    last_s = -np.inf
    last: NDArray[Any] | None = None
    for picture in pictures:
        if picture.time_s is None:
            yield picture
            continue
        if 0 <= picture.time_s - last_s < _MIN_INTERVAL_S:
            continue
        small = cv2.resize(picture.grey, _THUMBNAIL, interpolation=cv2.INTER_AREA).astype(int)
        if last is not None and np.abs(small - last).mean() < _MIN_GREY_CHANGE:
            continue
        last_s, last = picture.time_s, small
        yield picture


def _same_view(view: BoardView, other: BoardView, side_px: int) -> bool:
    if view.object_m.shape != other.object_m.shape or (view.object_m != other.object_m).any():
        return False
    moved_px = np.linalg.norm(view.image_px - other.image_px, axis=1)
    return float(moved_px.mean()) < _MIN_MOTION_SHARE * side_px


def _size_text(picture: Picture) -> str:
    height, width = picture.grey.shape
    return f"{width}x{height} px"
