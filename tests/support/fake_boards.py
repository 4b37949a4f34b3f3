"""Synthetic boards seen by a known camera: points alone, or whole images.

A separate module, because tests in several folders use it.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.boards import AprilGrid, Board, BoardView, CharucoBoard, Checkerboard, CircleGrid
from calib.camera import PinholeCamera

Float = NDArray[np.floating[Any]]
Grey = NDArray[np.uint8]

RADTAN = PinholeCamera(640, 480, 520, 523, 325, 236, (-0.18, 0.05, 0.001, -0.0015, 0.0))
FISHEYE = PinholeCamera(640, 480, 230, 231, 322, 238, (0.02, -0.01, 0.003, -0.001), "fisheye")
TRUTH = {"radtan": RADTAN, "fisheye": FISHEYE}
CHECKERBOARD = Checkerboard(9, 6, 0.025)
BOARDS: dict[str, Board] = {
    "checkerboard": CHECKERBOARD,
    "charuco": CharucoBoard(8, 6, 0.03, 0.022, "4x4_50"),
    "circles": CircleGrid(8, 5, 0.025),
    "asymmetric": CircleGrid(4, 9, 0.02, asymmetric=True),
}
_PX_PER_STEP, _FINER = 40, 2


class Pose(NamedTuple):
    """From board to camera points."""

    rotation: Float
    translation_m: Float

    @property
    def vector(self) -> Float:
        return np.concatenate([cv2.Rodrigues(self.rotation)[0].ravel(), self.translation_m])


def _matrix(camera: PinholeCamera) -> Float:
    return np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1.0]])


def undistorted(camera: PinholeCamera, xy_px: Float) -> Float:
    """Convert (..., 2) px in OpenCV's convention to (..., 2) coordinates at z = 1."""
    matrix = _matrix(camera)
    function = cv2.undistortPoints
    if camera.distortion_model == "fisheye":
        function = cv2.fisheye.undistortPoints
    terms, until = np.array(camera.distortion), (3, 60, 1e-10)
    flat = np.ascontiguousarray(xy_px, np.float64).reshape(-1, 1, 2)
    return function(flat, matrix, terms, criteria=until).reshape(xy_px.shape)


def projected(camera: PinholeCamera, pose: Pose, object_m: Float) -> Float:
    """Project (N, 3) board points to (N, 2) continuous px."""
    matrix = _matrix(camera)
    function = (
        cv2.fisheye.projectPoints if camera.distortion_model == "fisheye" else (cv2.projectPoints)
    )
    points = np.ascontiguousarray(object_m, np.float64).reshape(-1, 1, 3)
    vector, terms = pose.vector, np.array(camera.distortion)
    return function(points, vector[:3], vector[3:], matrix, terms)[0].reshape(-1, 2) + 0.5


def poses(
    camera: PinholeCamera, count: int, seed: int, tilt_deg: float = 35.0, spread: float = 0.62
) -> list[Pose]:
    """Poses of a board of about 0.2 x 0.13 m over the whole image, near and far, tilted."""
    rng = np.random.default_rng(seed)
    nearer = 0.42 if camera.distortion_model == "fisheye" else 1.0
    found = []
    for i in range(count):
        column, row = (i % 4 + 0.5) / 4 - 0.5, (i // 4 % 3 + 0.5) / 3 - 0.5
        at_px = np.array(
            [
                camera.width * (0.5 + column * spread * 1.1),
                camera.height * (0.5 + row * spread * 1.1),
            ]
        )
        x, y = undistorted(camera, at_px)
        ray = np.array([x, y, 1]) / np.sqrt(1 + x * x + y * y)
        turn_rad = rng.uniform(0, 2 * np.pi)
        tilt_rad = np.radians(rng.uniform(0.3, 1) * tilt_deg)
        tilt = np.array([np.cos(turn_rad), np.sin(turn_rad), 0]) * tilt_rad
        rotation = (
            cv2.Rodrigues(tilt)[0] @ cv2.Rodrigues(np.array([0, 0, rng.uniform(-0.4, 0.4)]))[0]
        )
        if camera.distortion_model == "fisheye":  # facing the camera, wherever it is
            across = np.cross([0, 0, 1], ray)
            length = np.linalg.norm(across)
            rotation = cv2.Rodrigues(across / length * np.arcsin(length))[0] @ rotation
        middle_m = ray * rng.uniform(0.3, 0.6) * nearer
        found.append(Pose(rotation, middle_m - rotation @ [0.1, 0.065, 0]))
    return found


def object_points(board: Checkerboard) -> Float:
    rows, columns = np.mgrid[0 : board.rows, 0 : board.columns].reshape(2, -1)
    return np.stack([columns, rows, 0 * rows], -1) * board.square_m


def seen_points(
    camera: PinholeCamera,
    some_poses: Sequence[Pose],
    seed: int,
    noise_px: float = 0.1,
) -> list[BoardView]:
    """Views of the checkerboard with noise, only those entirely inside the image."""
    rng = np.random.default_rng(seed)
    object_m = object_points(CHECKERBOARD)
    views = []
    for i, pose in enumerate(some_poses):
        exact_px = projected(camera, pose, object_m)
        if (exact_px > 0).all() and (exact_px < (camera.width, camera.height)).all():
            noisy_px = exact_px + rng.normal(0, noise_px, exact_px.shape)
            views.append(BoardView(f"view{i}", noisy_px, object_m))
    return views


def printed(board: Board) -> tuple[Grey, float, float]:
    """Return the printed board, px per metre, and its first point in px from the corner."""
    px, dark, light = _PX_PER_STEP, 25, 230
    if isinstance(board, Checkerboard):
        rows, columns = np.mgrid[0 : board.rows + 1, 0 : board.columns + 1]
        squares = np.where((rows + columns) % 2, light, dark).astype(np.uint8)
        sheet = np.kron(squares, np.ones((px, px), np.uint8))
        return _margin(sheet, light), px / board.square_m, 2 * px
    if isinstance(board, CharucoBoard):
        markers = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        size = (board.columns, board.rows)
        pattern = cv2.aruco.CharucoBoard(size, board.square_m, board.marker_m, markers)
        pattern.setLegacyPattern(board.legacy)
        sheet = pattern.generateImage((board.columns * px, board.rows * px))
        return _margin(np.clip(sheet, dark, light), light), px / board.square_m, px
    if isinstance(board, AprilGrid):
        gap = round(board.spacing * 2 * px)
        return _margin(april_sheet(board), light), 2 * px / board.tag_m, px + gap
    assert isinstance(board, CircleGrid)
    columns = 2 * board.columns if board.asymmetric else board.columns
    sheet = np.full(((board.rows + 1) * px, (columns + 1) * px), light, np.uint8)
    for row in range(board.rows):
        for column in range(board.columns):
            x = 2 * column + row % 2 if board.asymmetric else column
            middle = ((x + 1) * px * 16 - 8, (row + 1) * px * 16 - 8)
            cv2.circle(sheet, middle, int(0.25 * px * 16), dark, -1, cv2.LINE_AA, 4)
    return sheet, px / board.spacing_m, px


def april_sheet(board: AprilGrid, border: int = 2, turns: int = 2, up: bool = True) -> Grey:
    """Draw a grid as Kalibr does, with black squares between the corners of the tags."""
    dark, light, side = 25, 230, 2 * _PX_PER_STEP
    gap = round(board.spacing * side)
    step = side + gap
    sheet = np.full((board.rows * step + gap, board.columns * step + gap), light, np.uint8)
    tags = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number in range(board.rows * board.columns):
        row, column = divmod(number, board.columns)
        x, y = gap + column * step, gap + (board.rows - 1 - row if up else row) * step
        tag = cv2.aruco.generateImageMarker(tags, number, side, borderBits=border)
        sheet[y : y + side, x : x + side] = np.clip(np.rot90(tag, turns), dark, light)
    for y in range(0, sheet.shape[0], step):
        for x in range(0, sheet.shape[1], step):
            sheet[y : y + gap, x : x + gap] = dark
    return sheet


def _margin(sheet: Grey, light: int) -> Grey:
    px = _PX_PER_STEP
    return cv2.copyMakeBorder(sheet, px, px, px, px, cv2.BORDER_CONSTANT, value=light)


@cache
def _fine_rays(camera: PinholeCamera) -> tuple[Float, Float]:
    """Return x and y at z = 1 of several rays per pixel along each side."""
    columns = (np.arange(camera.width * _FINER) + 0.5) / _FINER - 0.5
    rows = (np.arange(camera.height * _FINER) + 0.5) / _FINER - 0.5
    rays = undistorted(camera, np.stack(np.meshgrid(columns, rows), -1)).astype(np.float32)
    return rays[..., 0], rays[..., 1]


def rendered(camera: PinholeCamera, board: Board, some_poses: Sequence[Pose]) -> list[Grey]:
    """Render images of the board with blur and noise."""
    sheet, px_per_m, first_px = printed(board)
    x, y = _fine_rays(camera)
    rng = np.random.default_rng(7)
    images = []
    for rotation, translation_m in some_poses:
        # A board point u, v of the ray x, y: (x, y, 1) ~ r1 u + r2 v + t, so a homography.
        to_board = np.linalg.inv(np.stack([rotation[:, 0], rotation[:, 1], translation_m], 1))
        to_board = to_board.astype(np.float32)
        u, v, w = (to_board[i, 0] * x + to_board[i, 1] * y + to_board[i, 2] for i in range(3))
        ahead = w > 1e-6
        w = np.where(ahead, w, 1)
        map_x, map_y = (
            np.where(ahead, part / w * px_per_m + first_px - 0.5, -99).astype(np.float32)
            for part in (u, v)
        )
        fine = cv2.remap(
            sheet, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=120
        )
        size = (camera.width, camera.height)
        image = cv2.resize(fine.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        image = cv2.GaussianBlur(image, (0, 0), 0.7)
        noisy = np.rint(image + rng.normal(0, 2, image.shape))
        images.append(np.clip(noisy, 0, 255).astype(np.uint8))
    return images
