"""One marker of known size, found in any picture."""

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from calib.boards import MARKER_FORM, SingleMarker, parse_marker


def picture_of(marker: SingleMarker, corners_px: np.ndarray) -> np.ndarray:
    """A grey picture with a marker whose corners are at these places, in continuous px."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    printed = cv2.aruco.generateImageMarker(dictionary, marker.number, 240)
    sheet = cv2.copyMakeBorder(printed, 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255)
    here = np.array([[40, 40], [280, 40], [280, 280], [40, 280]], np.float32) - 0.5
    turn = cv2.getPerspectiveTransform(here, (corners_px - 0.5).astype(np.float32))
    grey = cv2.warpPerspective(sheet, turn, (640, 360), borderValue=120, flags=cv2.INTER_AREA)
    return cv2.GaussianBlur(grey, (3, 3), 0.6)


def test_every_copy_of_the_marker_is_found_at_its_place() -> None:
    marker = parse_marker(MARKER_FORM)
    assert (marker.dictionary, marker.number, marker.side_m) == ("4x4_50", 7, 0.16)
    corners_px = np.array([[100.3, 80.2], [171.7, 88.4], [166.1, 160.9], [96.2, 150.0]])
    [found] = marker.detect(picture_of(marker, corners_px))
    assert np.abs(found - corners_px).max() < 0.8
    other = SingleMarker("4x4_50", 8, 0.16)
    assert len(other.detect(picture_of(marker, corners_px))) == 0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("aruco:4x4_50:7", "expected aruco:DICTIONARY:NUMBER:SIDE"),
        ("7", "expected aruco:DICTIONARY:NUMBER:SIDE"),
        ("aruco:9x9_50:7:0.1", "dictionary is '9x9_50': expected one of"),
        ("aruco:4x4_50:50:0.1", "has 50 markers: expected 51"),
        ("aruco:4x4_50:-1:0.1", "number is -1: expected a marker's number"),
        ("aruco:4x4_50:7:16", "side_m is 16: expected metres"),
        ("aruco:4x4_50:x:0.1", "expected aruco:DICTIONARY:NUMBER:SIDE"),
    ],
)
def test_wrong_markers_are_named(text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        parse_marker(text)
