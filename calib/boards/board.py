"""Calibration boards: what is printed on them, and finding it in an image."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import CalibError
from calib.pixels import opencv_to_image

Float = NDArray[np.floating[Any]]
Grey = NDArray[np.uint8]

LEAST_POINTS: Final = 8
_MOST, _LONGEST_M = 100, 2.0
_CORNER_WINDOW, _LEAST_WINDOW_PX, _MOST_WINDOW_PX = 0.35, 2, 30
_REFINE_UNTIL = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
_SEARCHED_PX, _LEAST_BLOB_PX2 = 1600, 25.0


class Board(Protocol):
    """A flat target with points at known places."""

    def detect(self, grey: Grey) -> tuple[Float, Float] | None:
        """Find the board in an (H, W) uint8 image.

        Returns (N, 2) corner-based px and, of the same points, (N, 3) metres on the board with
        z = 0; None where the board is not found.
        """


@dataclass(frozen=True)
class Checkerboard:
    """A checkerboard with ``columns`` x ``rows`` inner corners; all of them must be in view."""

    columns: int
    rows: int
    square_m: float

    def __post_init__(self) -> None:
        _check_counts(self.columns, self.rows, "inner corners")
        _check_lengths(square_m=self.square_m)

    def detect(self, grey: Grey) -> tuple[Float, Float] | None:
        """See ``Board``.

        Large images are searched at a smaller size. The corners found by sectors are refined on
        the gradients around them, which leaves a fifth of their error.
        """
        scale = min(1.0, _SEARCHED_PX / max(grey.shape))
        small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        found, corners = cv2.findChessboardCornersSB(
            small, (self.columns, self.rows), flags=cv2.CALIB_CB_NORMALIZE_IMAGE
        )
        if not found:
            return None
        shrunk = np.array(small.shape[::-1]) / grey.shape[::-1]
        centred = (np.asarray(corners, np.float64).reshape(-1, 2) + 0.5) / shrunk - 0.5
        window_px = _CORNER_WINDOW * _least_step_px(centred.reshape(self.rows, self.columns, 2))
        object_m = _grid(self.columns, self.rows) * self.square_m
        return opencv_to_image(_refined(grey, centred, window_px)), object_m


@dataclass(frozen=True)
class CharucoBoard:
    """``columns`` x ``rows`` squares with ArUco markers in the white ones; a part may be in view.

    ``dictionary`` is OpenCV's name of the markers, such as 4x4_50.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    dictionary: str

    def __post_init__(self) -> None:
        _check_counts(self.columns, self.rows, "squares")
        _check_lengths(square_m=self.square_m, marker_m=self.marker_m)
        if self.marker_m >= self.square_m:
            raise CalibError(
                f"marker_m is {self.marker_m:g}: expected less than square_m, {self.square_m:g}"
            )
        dictionaries = _dictionaries()
        if self.dictionary not in dictionaries:
            known = ", ".join(sorted(dictionaries))
            raise CalibError(f"dictionary is {self.dictionary!r}: expected one of {known}")
        markers = len(_predefined(self.dictionary).bytesList)
        needed = self.columns * self.rows // 2
        if markers < needed:
            raise CalibError(
                f"dictionary {self.dictionary} has {markers} markers: expected {needed} for"
                f" {self.columns}x{self.rows} squares"
            )

    def detect(self, grey: Grey) -> tuple[Float, Float] | None:
        """See ``Board``.

        The corners are refined once more here, as some versions of OpenCV hand them out half a
        pixel off; the window stays clear of the markers.
        """
        board, detector = _charuco(self)
        corners, ids, _, _ = detector.detectBoard(grey)
        if ids is None or len(ids) < LEAST_POINTS or board.checkCharucoCornersCollinear(ids):
            return None
        object_m = np.asarray(board.getChessboardCorners(), np.float64)[ids.ravel()]
        centred = np.asarray(corners, np.float64).reshape(-1, 2)
        gap = (1 - self.marker_m / self.square_m) / 2
        apart_px = np.linalg.norm(centred[:, None] - centred, axis=-1)
        step_px = float(np.min(apart_px[apart_px > 0]))
        window_px = min(gap, _CORNER_WINDOW) * step_px
        return opencv_to_image(_refined(grey, centred, window_px)), object_m


@dataclass(frozen=True)
class CircleGrid:
    """A grid of dark circles on white; all of them must be in view.

    ``columns`` circles in each of ``rows`` rows. ``spacing_m`` lies between the centres of
    neighbouring rows; between those of one row it is the same, or twice as much where
    ``asymmetric``: then every second row is shifted by ``spacing_m``.

    What is found is the middle of each circle's ellipse, which near a wide lens lies up to some
    tenths of a pixel beside the circle's centre: there, boards with corners are better.
    """

    columns: int
    rows: int
    spacing_m: float
    asymmetric: bool = False

    def __post_init__(self) -> None:
        _check_counts(self.columns, self.rows, "circles")
        _check_lengths(spacing_m=self.spacing_m)

    def detect(self, grey: Grey) -> tuple[Float, Float] | None:
        """See ``Board``."""
        kind = cv2.CALIB_CB_ASYMMETRIC_GRID if self.asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
        blobs = cv2.SimpleBlobDetector.Params()
        blobs.minArea = _LEAST_BLOB_PX2
        blobs.maxArea = max(2 * _LEAST_BLOB_PX2, grey.size / (self.columns * self.rows))
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


@cache
def _dictionaries() -> dict[str, int]:
    """OpenCV's sets of markers by name."""
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


def _check_counts(columns: int, rows: int, what: str) -> None:
    for name, count in (("columns", columns), ("rows", rows)):
        if not 3 <= count <= _MOST:
            raise CalibError(f"{name} is {count}: expected 3 to {_MOST} {what}")


def _check_lengths(**lengths_m: float) -> None:
    for name, length_m in lengths_m.items():
        if not 0 < length_m <= _LONGEST_M:
            raise CalibError(
                f"{name} is {length_m:g}: expected metres, more than 0 and up to {_LONGEST_M:g}"
            )


def _grid(columns: int, rows: int) -> Float:
    """(rows * columns, 3) whole steps along x and y, row by row."""
    y, x = np.mgrid[0:rows, 0:columns].reshape(2, -1)
    return np.stack([x, y, np.zeros_like(x)], -1).astype(np.float64)


def _least_step_px(grid_px: Float) -> float:
    """The smallest distance between neighbours of a (rows, columns, 2) grid."""
    along = np.linalg.norm(np.diff(grid_px, axis=1), axis=-1)
    across = np.linalg.norm(np.diff(grid_px, axis=0), axis=-1)
    return float(min(along.min(), across.min()))


def _refined(grey: Grey, centred_px: Float, window_px: float) -> Float:
    """Corners, in OpenCV's px, moved to where the gradients around them meet."""
    half = int(np.clip(window_px, _LEAST_WINDOW_PX, _MOST_WINDOW_PX))
    corners = np.array(centred_px, np.float32).reshape(-1, 1, 2)  # OpenCV changes it in place
    refined = cv2.cornerSubPix(grey, corners, (half, half), (-1, -1), _REFINE_UNTIL)
    return np.asarray(refined, np.float64).reshape(-1, 2)
