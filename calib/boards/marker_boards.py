"""Boards of square markers with numbers: ChArUco boards and AprilGrids."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final

import cv2
import numpy as np

from basetree.arrays import Float, Int64, UInt8
from basetree.errors import InputError
from basetree.settings import Settings, limits
from calib.boards.corners import LEAST_POINTS, LENGTH, WINDOW_SHARE, counts, refine_corners
from calib.pixels import opencv_to_image

KALIBR_TAGS: Final = "apriltag_36h11"
_BORDERS = (2, 1)  # bits of black around a tag: of Kalibr, and of others
_DATA_BITS = 6  # along a side of a tag, within its border
# Of the thinnest stripe beside a corner: the outlines of tags that touch at their corners miss the
# corners by more than other outlines, and are found again in two steps.
_WINDOW_SHARES = (0.8, 0.4)
_MOST_MISFIT = 0.25  # of a tag's side; lenses bend the plane, wrong layouts miss by more


@dataclass(frozen=True)
class CharucoBoard(Settings, error=InputError):
    """A checkerboard with ArUco markers in its white squares; a part of it may be visible."""

    columns: int = field(metadata=counts("squares"))
    """Number of squares in a row."""
    rows: int = field(metadata=counts("squares"))
    """Number of rows of squares."""
    square_m: float = field(metadata=LENGTH)
    """Side of a square in metres."""
    marker_m: float = field(metadata=LENGTH)
    """Side of a marker in metres."""
    dictionary: str
    """OpenCV's marker dictionary in lower case, such as "4x4_50"."""
    legacy: bool = False
    """Whether the pattern is that of OpenCV before 4.6, which with an even number of rows begins
    with a white square. By default both patterns are tried."""

    def _check_together(self) -> None:
        if self.marker_m >= self.square_m:
            self._refuse(f"marker_m is {self.marker_m:g}", f"less than square_m, {self.square_m:g}")
        problem = problem_of_dictionary(
            self.dictionary,
            self.columns * self.rows // 2,
            f"{self.columns}x{self.rows} squares",
        )
        if problem is not None:
            self._refuse(*problem)

    @property
    def side_m(self) -> float:
        """See `Board.side_m`."""
        return self.square_m

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board; see `Board.detect`.

        The corners are refined again because some versions of OpenCV return them half a pixel off.
        The refinement window does not reach the markers.
        """
        corners, ids, _ = self._corners(grey)
        board, _ = _charuco(self, self.legacy)
        if len(ids) < LEAST_POINTS or board.checkCharucoCornersCollinear(ids):
            return None
        object_m = np.asarray(board.getChessboardCorners(), np.float64)[ids.ravel()]
        corners_px = np.asarray(corners, np.float64).reshape(-1, 2)
        gap = (1 - self.marker_m / self.square_m) / 2
        apart_px = np.linalg.norm(corners_px[:, None] - corners_px, axis=-1)
        step_px = float(np.min(apart_px[apart_px > 0]))
        window_px = min(gap, WINDOW_SHARE) * step_px
        return opencv_to_image(refine_corners(grey, corners_px, window_px)), object_m

    def seen_in_part(self, grey: UInt8) -> str:
        """Tell how many markers and corners are seen; see `Board.seen_in_part`."""
        _, ids, markers = self._corners(grey)
        found = f"{len(ids)} corners between them, expected {LEAST_POINTS} or more"
        return f"{markers} markers of {self.dictionary} and {found}" if markers else ""

    def _corners(self, grey: UInt8) -> tuple[Float, Int64, int]:
        """Find the corners between markers of the pattern that fits, the new one before the old.

        Returns:
            (N, 1, 2) corners in OpenCV's px, (N, 1) their numbers, and the number of markers.
        """
        _, detector = _charuco(self, self.legacy)
        found: tuple[Any, ...] = detector.detectBoard(grey)
        corners, ids, marker_px, marker_ids = found
        if ids is None and marker_ids is not None and not self.legacy:
            _, detector = _charuco(self, True)
            corners, ids, _, _ = detector.detectBoard(
                grey, markerCorners=marker_px, markerIds=marker_ids
            )
        if ids is None:
            corners, ids = np.zeros((0, 1, 2)), np.zeros((0, 1), np.int64)
        return (
            np.asarray(corners),
            np.asarray(ids, np.int64),
            0 if marker_ids is None else len(marker_ids),
        )


@dataclass(frozen=True)
class AprilGrid(Settings, error=InputError):
    """A grid of AprilTags, as Kalibr makes it; a part of it may be visible.

    Tag 0 is at a corner, and the numbers go along the rows. The points are the corners of the tags.
    """

    columns: int = field(metadata=counts("tags"))
    """Number of tags in a row."""
    rows: int = field(metadata=counts("tags"))
    """Number of rows of tags."""
    tag_m: float = field(metadata=LENGTH)
    """Side of a tag in metres, with its black border."""
    spacing: float = field(metadata=limits(over=0, most=2, expected="more than 0, up to 2"))
    """Space between two tags, as a share of `tag_m`."""
    dictionary: str = KALIBR_TAGS
    """OpenCV's dictionary of the tags in lower case."""

    def _check_together(self) -> None:
        problem = problem_of_dictionary(
            self.dictionary, self.columns * self.rows, f"{self.columns}x{self.rows} tags"
        )
        if problem is not None:
            self._refuse(*problem)

    @property
    def side_m(self) -> float:
        """See `Board.side_m`."""
        return self.tag_m

    def detect(self, grey: UInt8) -> tuple[Float, Float] | None:
        """Find the board; see `Board.detect`.

        Tools turn the tags on the sheet, and count the rows from the bottom or the top. Of all
        these layouts the one is taken in which the tags lie on a plane.
        """
        corners_px, ids, border = self._tags(grey)
        if 4 * len(ids) < LEAST_POINTS:
            return None
        layouts = [self._layout_m(ids, up, turns) for up in (True, False) for turns in range(4)]
        off_px = [_misfit_px(layout_m, corners_px) for layout_m in layouts]
        best = int(np.argmin(off_px))
        side_px = float(np.median(np.linalg.norm(corners_px[:, 1] - corners_px[:, 0], axis=-1)))
        if off_px[best] > _MOST_MISFIT * side_px:
            return None
        thin_px = min(self.spacing, border / (_DATA_BITS + 2 * border)) * side_px
        refined_px = corners_px.reshape(-1, 2)
        for share in _WINDOW_SHARES:
            refined_px = refine_corners(grey, refined_px, share * thin_px)
        flat_m = layouts[best].reshape(-1, 2)
        object_m = np.column_stack([flat_m, np.zeros(len(flat_m))])
        return opencv_to_image(refined_px), object_m

    def seen_in_part(self, grey: UInt8) -> str:
        """Tell how many tags are seen; see `Board.seen_in_part`."""
        _, ids, _ = self._tags(grey)
        count = len(ids)
        return f"{count} tags of {self.dictionary} that fit no such grid" if count else ""

    def _tags(self, grey: UInt8) -> tuple[Float, Int64, int]:
        """Return the tags: (N, 4, 2) corners in OpenCV's px, (N,) numbers, bits of their border."""
        best: tuple[Float, Int64, int] = np.zeros((0, 4, 2)), np.zeros(0, np.int64), _BORDERS[0]
        for border in _BORDERS:
            found: tuple[Any, ...] = tag_detector(self.dictionary, border).detectMarkers(grey)
            corners, ids, _ = found
            if ids is None:
                continue
            numbers = np.asarray(ids, np.int64).ravel()
            numbers, first = np.unique(numbers, return_index=True)
            places = np.asarray(corners, np.float64).reshape(-1, 4, 2)[first]
            inside = numbers < self.columns * self.rows
            if inside.sum() > len(best[1]):
                best = places[inside], numbers[inside], border
        return best

    def _layout_m(self, ids: Int64, up: bool, turns: int) -> Float:
        """Return the (N, 4, 2) corners on the board in metres, x right and y down."""
        step_m = self.tag_m * (1 + self.spacing)
        row = -(ids // self.columns) if up else ids // self.columns
        origin = np.stack([ids % self.columns, row], -1) * step_m
        around = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * self.tag_m
        return np.asarray(origin[:, None] + np.roll(around, turns, axis=0))


def _misfit_px(layout_m: Float, corners_px: Float) -> float:
    """Return the median distance of corners from a plane with this layout; infinite without one."""
    flat_m, flat_px = layout_m.reshape(-1, 2), corners_px.reshape(-1, 2)
    homography: Any = cv2.findHomography(flat_m, flat_px, cv2.LMEDS)[0]
    if homography is None:
        return np.inf
    fitted = cv2.perspectiveTransform(flat_m[:, None], homography)[:, 0]
    return float(np.median(np.linalg.norm(fitted - flat_px, axis=-1)))


def problem_of_dictionary(dictionary: str, needed: int, what: str) -> tuple[str, str] | None:
    """Return what is wrong with a dictionary of at least `needed` markers, and what is expected."""
    dictionaries = _dictionaries()
    if dictionary not in dictionaries:
        return f"dictionary is {dictionary!r}", f"one of {', '.join(sorted(dictionaries))}"
    markers = len(_predefined(dictionary).bytesList)
    if markers < needed:
        return f"dictionary {dictionary} has {markers} markers", f"{needed} for {what}"
    return None


@cache
def _dictionaries() -> dict[str, int]:
    """Return OpenCV's marker dictionaries by lower-case name."""
    start = "DICT_"
    names = [name for name in dir(cv2.aruco) if name.startswith(start)]
    return {name.removeprefix(start).lower(): getattr(cv2.aruco, name) for name in names}


def _predefined(dictionary: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(_dictionaries()[dictionary])


@cache
def _charuco(
    board: CharucoBoard, legacy: bool
) -> tuple[cv2.aruco.CharucoBoard, cv2.aruco.CharucoDetector]:
    squares, markers = (board.columns, board.rows), _predefined(board.dictionary)
    printed = cv2.aruco.CharucoBoard(squares, board.square_m, board.marker_m, markers)
    printed.setLegacyPattern(legacy)
    return printed, cv2.aruco.CharucoDetector(printed)


@cache
def tag_detector(dictionary: str, border: int) -> cv2.aruco.ArucoDetector:
    """Return the detector of markers with so many bits of black around them."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    return cv2.aruco.ArucoDetector(_predefined(dictionary), parameters)
