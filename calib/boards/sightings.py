"""From pictures to views of a board: new ones only, all of one size."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.boards.board import Board
from calib.boards.solve import BoardView
from calib.errors import CalibError

Grey = NDArray[np.uint8]

_THUMBNAIL: Final = (32, 24)
_SAME_PICTURE_GREYS = 0.5
_SAME_PLACE_SHARE = 0.01
_LEAST_PAUSE_S = 0.2


@dataclass(frozen=True, eq=False)
class Picture:
    """``grey`` (H, W) uint8; ``time_s`` where it is one of a video."""

    name: str
    grey: Grey
    time_s: float | None = None


@dataclass(frozen=True)
class Sightings:
    """``views`` of the board in images of ``width`` x ``height`` px, which is 0x0 without any.

    ``without_board`` and ``repeated`` name the pictures in which no board was found, and in which
    it was where another picture already shows it. ``pictures`` counts all that were looked at;
    those of a video that follow too closely, or show what the one before did, are passed over.
    """

    views: tuple[BoardView, ...]
    width: int
    height: int
    pictures: int
    without_board: tuple[str, ...]
    repeated: tuple[str, ...]


def find_boards(pictures: Iterable[Picture], board: Board) -> Sightings:
    """Look for the board in every picture that shows something new.

    Raises CalibError where a picture's size is not that of the first.
    """
    first: Picture | None = None
    views: list[BoardView] = []
    without_board: list[str] = []
    repeated: list[str] = []
    looked_at = 0
    for picture in _sampled(pictures):
        first = first or picture
        if picture.grey.shape != first.grey.shape:
            raise CalibError(
                f"{picture.name} is {_size_text(picture)}: expected {_size_text(first)},"
                f" as {first.name}; one camera has images of one size"
            )
        looked_at += 1
        found = board.detect(picture.grey)
        if found is None:
            without_board.append(picture.name)
            continue
        view = BoardView(picture.name, *found)
        if any(_same_place(view, other, max(picture.grey.shape)) for other in views):
            repeated.append(view.name)
        else:
            views.append(view)
    height, width = (0, 0) if first is None else first.grey.shape
    return Sightings(tuple(views), width, height, looked_at, tuple(without_board), tuple(repeated))


def _sampled(pictures: Iterable[Picture]) -> Iterable[Picture]:
    """Of a video the pictures that come a while after the last one and differ from it."""
    last_s = -np.inf
    last: NDArray[Any] | None = None
    for picture in pictures:
        if picture.time_s is None:
            yield picture
            continue
        if 0 <= picture.time_s - last_s < _LEAST_PAUSE_S:
            continue
        small = cv2.resize(picture.grey, _THUMBNAIL, interpolation=cv2.INTER_AREA).astype(int)
        if last is not None and np.abs(small - last).mean() < _SAME_PICTURE_GREYS:
            continue
        last_s, last = picture.time_s, small
        yield picture


def _same_place(view: BoardView, other: BoardView, side_px: int) -> bool:
    if view.object_m.shape != other.object_m.shape or (view.object_m != other.object_m).any():
        return False
    moved_px = np.linalg.norm(view.image_px - other.image_px, axis=1)
    return float(moved_px.mean()) < _SAME_PLACE_SHARE * side_px


def _size_text(picture: Picture) -> str:
    height, width = picture.grey.shape
    return f"{width}x{height} px"
