"""One square marker of known size, in any picture."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from basetree.arrays import Float, UInt8
from basetree.errors import InputError
from basetree.settings import Settings, limits
from calib.boards.corners import LENGTH, refine_corners
from calib.boards.marker_boards import problem_of_dictionary, tag_detector
from calib.pixels import opencv_to_image

MARKER_FORM: Final = "aruco:4x4_50:7:0.16"
_BORDER = 1  # bits of black around the data of a marker
_DATA_BITS = 6
# Half the side of the window in which a corner is refined, of the width of the black border.
_WINDOW_SHARE = 0.5
_LARGEST_ID = 2**16


@dataclass(frozen=True)
class SingleMarker(Settings, error=InputError):
    """One ArUco marker or AprilTag; pictures may show several copies of it."""

    dictionary: str
    """OpenCV's marker dictionary in lower case, such as "4x4_50"."""
    number: int = field(metadata=limits(0, _LARGEST_ID, expected="a marker's number, from 0"))
    """Its number in the dictionary."""
    side_m: float = field(metadata=LENGTH)
    """Side of its black square in metres."""

    def _check_together(self) -> None:
        needed = f"marker {self.number}, as numbers begin with 0"
        problem = problem_of_dictionary(self.dictionary, self.number + 1, needed)
        if problem is not None:
            self._refuse(*problem)

    def detect(self, grey: UInt8) -> Float:
        """Find all copies of the marker.

        Args:
            grey: (H, W) picture.

        Returns:
            (N, 4, 2) corners in continuous px, clockwise from the marker's own upper left one.
        """
        found_all: tuple[Any, ...] = tag_detector(self.dictionary, _BORDER).detectMarkers(grey)
        corners, ids, _ = found_all
        if ids is None:
            return np.zeros((0, 4, 2))
        own = np.asarray(ids).ravel() == self.number
        found = np.asarray(corners, np.float64).reshape(-1, 4, 2)[own]
        for index, corners_px in enumerate(found):
            side_px = float(np.linalg.norm(np.diff(corners_px, axis=0), axis=1).min())
            window_px = _WINDOW_SHARE * side_px / (_DATA_BITS + 2 * _BORDER)
            found[index] = refine_corners(grey, corners_px, window_px)
        return opencv_to_image(found)


def parse_marker(text: str) -> SingleMarker:
    """Create a marker from a text such as `MARKER_FORM`: aruco:DICTIONARY:NUMBER:SIDE_IN_METRES.

    Raises:
        InputError: If the text has another form or a value is invalid; the message quotes it.
    """
    kind, *parts = text.strip().lower().split(":")
    if kind == "aruco" and len(parts) == 3:
        try:
            return SingleMarker(parts[0].removeprefix("dict_"), int(parts[1]), float(parts[2]))
        except InputError as error:
            raise InputError(f"marker {text!r}: {error}") from error
        except ValueError:
            pass
    raise InputError(
        f"marker is {text!r}: expected aruco:DICTIONARY:NUMBER:SIDE with the side of its black"
        f" square in metres, such as {MARKER_FORM}"
    )
