"""Calibration boards: their geometry, their detection in an image, and texts that describe them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Protocol

import cv2
import numpy as np

from basetree.arrays import Float, UInt8
from basetree.errors import InputError
from basetree.settings import Settings
from calib.boards.corners import (
    LENGTH,
    WINDOW_SHARE,
    counts,
    grid,
    min_spacing_px,
    refine_corners,
)
from calib.boards.marker_boards import KALIBR_TAGS, AprilGrid, CharucoBoard
from calib.pixels import opencv_to_image

BOARD_FORMS: Final = (
    "checkerboard:9x6:0.025 (inner corners, side of a square in metres),"
    " charuco:8x6:0.03:0.022:4x4_50 (squares, sides of square and marker, dictionary; with :legacy"
    " for boards of OpenCV before 4.6 alone),"
    " aprilgrid:6x6:0.088:0.3 (tags, side of a tag, space between tags as a share of it),"
    " circles:7x5:0.02 or circles:4x11:0.02:asymmetric (circles per row x rows, row spacing"
    " in metres)"
)
_SEARCH_SIZE_PX, _MIN_BLOB_PX2 = 1600, 25.0


class Board(Protocol):
    """A flat calibration target with points at known positions."""

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board in an (H, W) uint8 image.

        Returns:
            The points in the image, (N, 2) continuous px, and on the board, (N, 3) metres with z =
            0; None if the board is not found.
        """

    @property
    def side_m(self) -> float:
        """Length in metres that gives the board its size: of a square, a tag or a spacing."""

    def seen_in_part(self, grey: UInt8) -> str:
        """Tell what is seen of the board in an image where it was not found; empty if nothing."""


@dataclass(frozen=True)
class Checkerboard(Settings, error=InputError):
    """A checkerboard; all its inner corners must be visible."""

    columns: int = field(metadata=counts("inner corners"))
    """Number of inner corners in a row."""
    rows: int = field(metadata=counts("inner corners"))
    """Number of rows of inner corners."""
    square_m: float = field(metadata=LENGTH)
    """Side of a square in metres."""

    @property
    def side_m(self) -> float:
        """See `Board.side_m`."""
        return self.square_m

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board; see `Board.detect`.

        Large images are searched at a reduced size. The corners of `findChessboardCornersSB` are
        refined on the image gradients at full size, which reduces their error to about a fifth.
        """
        scale = min(1.0, _SEARCH_SIZE_PX / max(grey.shape))
        small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        found, corners = cv2.findChessboardCornersSB(
            small, (self.columns, self.rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if not found:
            return None
        shrunk = np.array(small.shape[::-1]) / grey.shape[::-1]
        corners_px = (np.asarray(corners, np.float64).reshape(-1, 2) + 0.5) / shrunk - 0.5
        window_px = WINDOW_SHARE * min_spacing_px(corners_px.reshape(self.rows, self.columns, 2))
        object_m = grid(self.columns, self.rows) * self.square_m
        return opencv_to_image(refine_corners(grey, corners_px, window_px)), object_m

    def seen_in_part(self, grey: UInt8) -> str:
        """Tell nothing: the board is found as a whole; see `Board.seen_in_part`."""
        return ""


@dataclass(frozen=True)
class CircleGrid(Settings, error=InputError):
    """A grid of dark circles on white; all of them must be visible.

    The detected points are the centres of the circles' ellipses in the image. Near a wide-angle
    lens these differ from the projected circle centres by up to some tenths of a pixel; prefer
    boards with corners there.
    """

    columns: int = field(metadata=counts("circles"))
    """Number of circles in a row."""
    rows: int = field(metadata=counts("circles"))
    """Number of rows."""
    spacing_m: float = field(metadata=LENGTH)
    """Distance between neighbouring rows in metres. Within a row the distance is the same, or twice
    as much if asymmetric."""
    asymmetric: bool = False
    """Whether every second row is shifted by `spacing_m`."""

    @property
    def side_m(self) -> float:
        """See `Board.side_m`."""
        return self.spacing_m

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board; see `Board.detect`."""
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        blobs = cv2.SimpleBlobDetector.Params()
        blobs.minArea = _MIN_BLOB_PX2
        blobs.maxArea = max(2 * _MIN_BLOB_PX2, grey.size / (self.columns * self.rows))
        found, centres = cv2.findCirclesGrid(
            grey,
            (self.columns, self.rows),
            flags=kind,
            blobDetector=cv2.SimpleBlobDetector.create(blobs),
        )
        if not found:
            return None
        object_m = grid(self.columns, self.rows)
        if self.asymmetric:
            object_m[:, 0] = 2 * object_m[:, 0] + object_m[:, 1] % 2
        return opencv_to_image(centres.reshape(-1, 2)), object_m * self.spacing_m

    def seen_in_part(self, grey: UInt8) -> str:
        """Tell nothing: the board is found as a whole; see `Board.seen_in_part`."""
        return ""


def parse_board(text: str) -> Board:
    """Create a board from a text in one of the forms of `BOARD_FORMS`.

    Raises:
        InputError: If the text has no known form or a value is invalid; the message quotes it.
    """
    kind, *parts = text.strip().lower().split(":")
    try:
        if kind == "checkerboard" and len(parts) == 2:
            return Checkerboard(*_counts_of(parts[0]), float(parts[1]))
        if kind == "charuco" and (len(parts) == 4 or parts[4:] == ["legacy"]):
            sides_m = float(parts[1]), float(parts[2])
            legacy = len(parts) == 5
            return CharucoBoard(*_counts_of(parts[0]), *sides_m, parts[3], legacy=legacy)
        if kind == "aprilgrid" and len(parts) in (3, 4):
            dictionary = parts[3:] or [KALIBR_TAGS]
            return AprilGrid(*_counts_of(parts[0]), float(parts[1]), float(parts[2]), *dictionary)
        if kind == "circles" and (len(parts) == 2 or parts[2:] == ["asymmetric"]):
            return CircleGrid(*_counts_of(parts[0]), float(parts[1]), asymmetric=len(parts) == 3)
    except InputError as error:
        raise InputError(f"board {text!r}: {error}") from error
    except ValueError:
        pass
    raise InputError(f"board is {text!r}: expected one such as {BOARD_FORMS}")


def _counts_of(text: str) -> tuple[int, int]:
    columns, rows = text.split("x")
    return int(columns), int(rows)
