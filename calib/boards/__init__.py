"""Camera calibration from images of flat boards.

`find_boards` detects the board in images; `calibrate_camera` turns the views into a Calibration
or a CalibrationFailure.
"""

from calib.boards.board import BOARD_FORMS, Board, Checkerboard, CircleGrid, parse_board
from calib.boards.calibrate import calibrate_camera
from calib.boards.coverage import Coverage
from calib.boards.detections import BoardDetections, Picture, find_boards
from calib.boards.marker_boards import AprilGrid, CharucoBoard
from calib.boards.result import Calibration, CalibrationFailure, Dropped, Parameter, ViewResult
from calib.boards.single_marker import MARKER_FORM, SingleMarker, parse_marker
from calib.boards.solve import LENS_MODELS, BoardView

__all__ = [
    "BOARD_FORMS",
    "LENS_MODELS",
    "MARKER_FORM",
    "AprilGrid",
    "Board",
    "BoardDetections",
    "BoardView",
    "Calibration",
    "CalibrationFailure",
    "CharucoBoard",
    "Checkerboard",
    "CircleGrid",
    "Coverage",
    "Dropped",
    "Parameter",
    "Picture",
    "SingleMarker",
    "ViewResult",
    "calibrate_camera",
    "find_boards",
    "parse_board",
    "parse_marker",
]
