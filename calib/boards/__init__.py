"""Camera calibration from pictures of flat boards.

find_boards -> calibrate_camera -> a Calibration with its camera, or a CalibrationFailure
"""

from calib.boards.board import Board, CharucoBoard, Checkerboard, CircleGrid
from calib.boards.calibrate import calibrate_camera
from calib.boards.coverage import Coverage
from calib.boards.parse import BOARD_FORMS, parse_board
from calib.boards.result import Calibration, CalibrationFailure, Dropped, Parameter, ViewResult
from calib.boards.sightings import Picture, Sightings, find_boards
from calib.boards.solve import LENS_MODELS, BoardView

__all__ = [
    "BOARD_FORMS",
    "LENS_MODELS",
    "Board",
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
    "Sightings",
    "ViewResult",
    "calibrate_camera",
    "find_boards",
    "parse_board",
]
