"""Calibration boards: their geometry, their detection in an image, and texts that describe them."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Final, Protocol

import cv2
import numpy as np

from basetree.arrays import Float, UInt8
from basetree.errors import InputError
from basetree.settings import Settings, limits
from basetree.settings.metadata import Metadata
from calib.pixels import opencv_to_image

LEAST_POINTS: Final = 8
BOARD_FORMS: Final = (
    "checkerboard:9x6:0.025 (inner corners, side of a square in metres),"
    " charuco:8x6:0.03:0.022:4x4_50 (squares, sides of square and marker, dictionary),"
    " circles:7x5:0.02 or circles:4x11:0.02:asymmetric (circles per row x rows, row spacing"
    " in metres)"
)
_MAX_COUNT, _MAX_LENGTH_M = 100, 2.0
_WINDOW_SHARE, _MIN_WINDOW_PX, _MAX_WINDOW_PX = 0.35, 2, 30
_REFINE_CRITERIA = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
_SEARCH_SIZE_PX, _MIN_BLOB_PX2 = 1600, 25.0


def _counts(what: str) -> Metadata:
    return limits(3, _MAX_COUNT, expected=f"3 to {_MAX_COUNT} {what}")


_LENGTH: Final = limits(
    over=0,
    most=_MAX_LENGTH_M,
    expected=f"metres, more than 0 and up to {_MAX_LENGTH_M:g}",
    style="g",
)


class Board(Protocol):
    """A flat calibration target with points at known positions."""

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board in an (H, W) uint8 image.

        Returns:
            The points in the image, (N, 2) continuous px, and on the board, (N, 3) metres with z =
            0; None if the board is not found.
        """


@dataclass(frozen=True)
class Checkerboard(Settings, error=InputError):
    """A checkerboard; all its inner corners must be visible."""

    columns: int = field(metadata=_counts("inner corners"))
    """Number of inner corners in a row."""
    rows: int = field(metadata=_counts("inner corners"))
    """Number of rows of inner corners."""
    square_m: float = field(metadata=_LENGTH)
    """Side of a square in metres."""

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
        window_px = _WINDOW_SHARE * _min_spacing_px(corners_px.reshape(self.rows, self.columns, 2))
        object_m = _grid(self.columns, self.rows) * self.square_m
        return opencv_to_image(_refine_corners(grey, corners_px, window_px)), object_m


@dataclass(frozen=True)
class CharucoBoard(Settings, error=InputError):
    """A checkerboard with ArUco markers in its white squares; a part of it may be visible."""

    columns: int = field(metadata=_counts("squares"))
    """Number of squares in a row."""
    rows: int = field(metadata=_counts("squares"))
    """Number of rows of squares."""
    square_m: float = field(metadata=_LENGTH)
    """Side of a square in metres."""
    marker_m: float = field(metadata=_LENGTH)
    """Side of a marker in metres."""
    dictionary: str
    """OpenCV's marker dictionary in lower case, such as "4x4_50"."""

    def _check_together(self) -> None:
        if self.marker_m >= self.square_m:
            self._refuse(f"marker_m is {self.marker_m:g}", f"less than square_m, {self.square_m:g}")
        dictionaries = _dictionaries()
        if self.dictionary not in dictionaries:
            known = ", ".join(sorted(dictionaries))
            self._refuse(f"dictionary is {self.dictionary!r}", f"one of {known}")
        markers = len(_predefined(self.dictionary).bytesList)
        needed = self.columns * self.rows // 2
        if markers < needed:
            self._refuse(
                f"dictionary {self.dictionary} has {markers} markers",
                f"{needed} for {self.columns}x{self.rows} squares",
            )

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board; see `Board.detect`.

        The corners are refined again because some versions of OpenCV return them half a pixel off.
        The refinement window does not reach the markers.
        """
        board, detector = _charuco(self)
        corners, ids, _, _ = detector.detectBoard(grey)
        if ids is None or len(ids) < LEAST_POINTS or board.checkCharucoCornersCollinear(ids):
            return None
        object_m = np.asarray(board.getChessboardCorners(), np.float64)[ids.ravel()]
        corners_px = np.asarray(corners, np.float64).reshape(-1, 2)
        gap = (1 - self.marker_m / self.square_m) / 2
        apart_px = np.linalg.norm(corners_px[:, None] - corners_px, axis=-1)
        step_px = float(np.min(apart_px[apart_px > 0]))
        window_px = min(gap, _WINDOW_SHARE) * step_px
        return opencv_to_image(_refine_corners(grey, corners_px, window_px)), object_m


@dataclass(frozen=True)
class CircleGrid(Settings, error=InputError):
    """A grid of dark circles on white; all of them must be visible.

    The detected points are the centres of the circles' ellipses in the image. Near a wide-angle
    lens these differ from the projected circle centres by up to some tenths of a pixel; prefer
    boards with corners there.
    """

    columns: int = field(metadata=_counts("circles"))
    """Number of circles in a row."""
    rows: int = field(metadata=_counts("circles"))
    """Number of rows."""
    spacing_m: float = field(metadata=_LENGTH)
    """Distance between neighbouring rows in metres. Within a row the distance is the same, or twice
    as much if asymmetric."""
    asymmetric: bool = False
    """Whether every second row is shifted by `spacing_m`."""

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
        object_m = _grid(self.columns, self.rows)
        if self.asymmetric:
            object_m[:, 0] = 2 * object_m[:, 0] + object_m[:, 1] % 2
        return opencv_to_image(centres.reshape(-1, 2)), object_m * self.spacing_m


def parse_board(text: str) -> Board:
    """Create a board from a text in one of the forms of `BOARD_FORMS`.

    Raises:
        InputError: If the text has no known form or a value is invalid; the message quotes it.
    """
    kind, *parts = text.strip().lower().split(":")
    try:
        if kind == "checkerboard" and len(parts) == 2:
            return Checkerboard(*_counts_of(parts[0]), float(parts[1]))
        if kind == "charuco" and len(parts) == 4:
            return CharucoBoard(*_counts_of(parts[0]), float(parts[1]), float(parts[2]), parts[3])
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


@cache
def _dictionaries() -> dict[str, int]:
    """Return OpenCV's marker dictionaries by lower-case name."""
    start = "DICT_"
    names = [name for name in dir(cv2.aruco) if name.startswith(start)]
    return {name.removeprefix(start).lower(): getattr(cv2.aruco, name) for name in names}


def _predefined(dictionary: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(_dictionaries()[dictionary])


@cache
def _charuco(board: CharucoBoard) -> tuple[cv2.aruco.CharucoBoard, cv2.aruco.CharucoDetector]:
    squares, markers = (board.columns, board.rows), _predefined(board.dictionary)
    printed = cv2.aruco.CharucoBoard(squares, board.square_m, board.marker_m, markers)
    return printed, cv2.aruco.CharucoDetector(printed)


def _grid(columns: int, rows: int) -> Float:
    """Return (rows * columns, 3) integer grid points, row by row, z = 0."""
    y, x = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    return np.stack([x, y, np.zeros_like(x)], -1).astype(np.float64)


def _min_spacing_px(grid_px: Float) -> float:
    """Return the smallest distance between neighbours of a (rows, columns, 2) grid."""
    along = np.linalg.norm(np.diff(grid_px, axis=1), axis=-1)
    across = np.linalg.norm(np.diff(grid_px, axis=0), axis=-1)
    return float(min(along.min(), across.min()))


def _refine_corners(grey: UInt8, corners_px: Float, window_px: float) -> Float:
    """Refine corners, in OpenCV's px, to sub-pixel accuracy on the image gradients."""
    half = int(np.clip(window_px, _MIN_WINDOW_PX, _MAX_WINDOW_PX))
    corners = np.array(corners_px, np.float32).reshape(-1, 1, 2)  # OpenCV changes it in place
    refined = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), _REFINE_CRITERIA)
    return np.asarray(refined, np.float64).reshape(-1, 2)
