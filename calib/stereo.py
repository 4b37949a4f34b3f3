"""Depth from two calibrated pictures: rectification, matching, and a deviation for each pixel.

The pictures are rectified by Bouguet's method (Bradski and Kaehler, 2008) and matched by
semi-global matching (Hirschmüller, 2008), both of OpenCV. A disparity of d px is a depth of f b / d
for the focal length f and the baseline b, so that its error is that of d times z² / (f b).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, NamedTuple, cast

import cv2
import numpy as np

from basetree.arrays import Bool, Float, Float32, UInt8
from basetree.normal import MEDIAN_ABS_NORMAL
from calib.camera import PinholeCamera
from calib.distortion import FISHEYE
from calib.errors import CameraError
from calib.transform import RigidTransform

NEAREST_M: Final = 0.8
"""Nearer surfaces are not matched, as the search for them would cost the most time."""

MATCH_STD_PX: Final = 0.05
"""Least standard deviation of a disparity: interpolation between pixels, and slanted surfaces."""

_MOST_STD_PX: Final = 0.6  # of a disparity that is used
_MOST_DISPARITIES: Final = 512
_BLOCK_PX: Final = 5
_SPECKLE_PX, _SPECKLE_RANGE = 150, 2
_STEPS: Final = 16  # of SGBM's disparities per pixel
_REFINEMENTS: Final = 4
_REFINED_BLOCK_PX: Final = 7
_LARGEST_STEP_PX, _FARTHEST_PX = 0.5, 1.0  # of the refinement, from semi-global matching
_CAUCHY: Final = 2.0
# On rendered pairs errors are so much larger than independent noise of the pixels makes them.
_FIT_FACTOR: Final = 1.8
_LEAST_NOISE: Final = 0.5  # grey levels, of rounding
_LEAST_BASELINE_M, _MOST_BASELINE_M = 0.01, 5.0
_MOST_TURN_DEG: Final = 20.0


@dataclass(frozen=True, eq=False)
class StereoPair:
    """Two calibrated cameras.

    Attributes:
        left: The left camera.
        right: The right camera.
        right_from_left: Transform from the left camera's frame to the right one's: OpenCV's R, T.

    Raises:
        CameraError: They do not stand side by side and look nearly the same way, are for pictures
            of different sizes, or one lens is a fisheye and the other is not.
    """

    left: PinholeCamera
    right: PinholeCamera
    right_from_left: RigidTransform

    def __post_init__(self) -> None:
        across, down, ahead = self.right_from_left.inverse().translation_m.tolist()
        if not _LEAST_BASELINE_M <= abs(across) <= _MOST_BASELINE_M:
            raise CameraError(
                f"the right camera stands {across:g} m beside the left one: expected"
                f" {_LEAST_BASELINE_M:g} to {_MOST_BASELINE_M:g} m (are they millimetres?)"
            )
        if across < 0:
            raise CameraError(
                f"the right camera stands {-across:g} m to the left of the left one: expected left"
                " and right in their order"
            )
        turn_rad = np.linalg.norm(cv2.Rodrigues(self.right_from_left.rotation)[0])
        if max(abs(down), abs(ahead)) > across or np.degrees(turn_rad) > _MOST_TURN_DEG:
            raise CameraError(
                f"the right camera stands {across:.3g} m beside, {down:.3g} m below and"
                f" {ahead:.3g} m ahead of the left one, turned by {np.degrees(turn_rad):.3g}"
                f" degrees: expected cameras side by side, turned by {_MOST_TURN_DEG:g} at most"
            )
        self._check_sizes()
        if len({camera.distortion_model for camera in (self.left, self.right)}) > 1:
            raise CameraError("one lens is a fisheye and the other is not: expected equal lenses")

    def _check_sizes(self) -> None:
        """Rectification takes one size; that of files without one is told by `scaled`."""
        left, right = self.left, self.right
        differ = (left.width, left.height) != (right.width, right.height)
        if left.has_size and right.has_size and differ:
            raise CameraError(
                f"the right camera is for {right.width}x{right.height} px and the left one for"
                f" {left.width}x{left.height}: expected one size, as `PinholeCamera.scaled` gives"
            )

    def scaled(self, width: int, height: int) -> StereoPair:
        """The pair for pictures of another size; CameraError if their shape is another."""
        left, right = (each.scaled(width, height) for each in (self.left, self.right))
        return StereoPair(left, right, self.right_from_left)

    @property
    def left_rotation(self) -> Float:
        """(3, 3) rotation from the left camera's frame to that of the rectified pictures."""
        return np.asarray(self._turns_and_matrices[0][0], np.float64)

    @cached_property
    def _turns_and_matrices(self) -> tuple[tuple[Float, Float], tuple[Float, Float]]:
        """Rotations (3, 3) to the rectified cameras, and their projections (3, 4)."""
        moved = self.right_from_left
        given = (
            *(*_matrix_and_terms(self.left), *_matrix_and_terms(self.right)),
            *((self.left.width, self.left.height), moved.rotation),
            moved.translation_m.reshape(3, 1),
        )
        found: Any
        try:
            if self.left.distortion_model == FISHEYE:
                found = cv2.fisheye.stereoRectify(*given, flags=cv2.CALIB_ZERO_DISPARITY)
            else:
                found = cv2.stereoRectify(*given, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)
        except cv2.error as error:
            raise CameraError("the pictures cannot be rectified: expected a pair") from error
        return (found[0], found[1]), (found[2], found[3])

    @cached_property
    def rectified(self) -> Rectified:
        """How the pictures are rectified."""
        turns, matrices = self._turns_and_matrices
        size = (self.left.width, self.left.height)
        is_fisheye = self.left.distortion_model == FISHEYE
        undistort = (
            cv2.fisheye.initUndistortRectifyMap if is_fisheye else cv2.initUndistortRectifyMap
        )
        maps: Any = [
            undistort(*_matrix_and_terms(lens), turn, matrix[:, :3], size, cv2.CV_32FC1)
            for lens, turn, matrix in zip((self.left, self.right), turns, matrices, strict=True)
        ]
        first, second = (np.asarray(matrix, np.float64) for matrix in matrices)
        fx, fy, cx, cy = (float(first[i, j]) for i, j in ((0, 0), (1, 1), (0, 2), (1, 2)))
        camera = PinholeCamera(*size, fx, fy, cx, cy)
        baseline_m = float(-second[0, 3] / second[0, 0])
        return Rectified(camera, baseline_m, self.left_rotation, (maps[0], maps[1]))


def _matrix_and_terms(camera: PinholeCamera) -> tuple[Float, Float]:
    matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    return matrix, np.array(camera.distortion or (0.0,) * 4)


class StereoDepth(NamedTuple):
    """What two pictures give.

    Attributes:
        image: (H, W, 3) uint8 BGR, the rectified left picture.
        depth_m: (H, W) float32 metres along z of the rectified left camera, 0 for no match.
        std_m: (H, W) float32 standard deviation of each; 0 for no match.
    """

    image: UInt8
    depth_m: Float32
    std_m: Float32


@dataclass(frozen=True, eq=False)
class Rectified:
    """Two cameras that look the same way, with rows that agree.

    Attributes:
        camera: Both rectified cameras; the second stands `baseline_m` to the right.
        baseline_m: Their distance.
        rotation: (3, 3) from the left camera's frame to the rectified one's.
        maps: Column and row of each rectified pixel in the pictures, of left and right.
    """

    camera: PinholeCamera
    baseline_m: float
    rotation: Float
    maps: tuple[tuple[Float32, Float32], tuple[Float32, Float32]]

    @property
    def focal_baseline(self) -> float:
        """Focal length times baseline, px m."""
        return self.camera.fx * self.baseline_m

    def depth(self, left: UInt8, right: UInt8) -> StereoDepth:
        """Rectify and match two pictures.

        A match has to be the same from left to right and from right to left, and is refined by
        least squares. Its deviation is in proportion to that of the fit, s / sqrt(sum of g²) for
        the scatter s of the differences of matched pixels and the horizontal gradients g within
        the block; `MATCH_STD_PX` is added.

        Args:
            left: (H, W, 3) uint8 BGR of the left camera.
            right: (H, W, 3) uint8 BGR of the right camera.

        Raises:
            CameraError: A picture does not have its camera's size, or is not of 8 bits.
        """
        size = (self.camera.width, self.camera.height)
        for name, image in (("left", left), ("right", right)):
            if image.dtype != np.uint8:
                raise CameraError(f"the {name} picture is {image.dtype}: expected uint8")
            if image.shape[1::-1] != size:
                raise CameraError(
                    f"the {name} picture is {image.shape[1]}x{image.shape[0]} px: expected the"
                    f" camera's {size[0]}x{size[1]} px"
                )
        pictures = [
            cast("UInt8", cv2.remap(image, *map_, cv2.INTER_LINEAR))
            for image, map_ in zip((left, right), self.maps, strict=True)
        ]
        greys = [_grey(picture) for picture in pictures]
        disparity = self._disparity(*greys)
        disparity, std_px = _refined(greys[0], greys[1], disparity)
        disparity = _without_specks(np.where(std_px < _MOST_STD_PX, disparity, -1))
        matched = disparity > 0
        safe = np.where(matched, disparity, 1.0)
        depth_m = np.where(matched, self.focal_baseline / safe, 0.0).astype(np.float32)
        std_px = np.where(matched, std_px, 0.0)
        std_m = (depth_m.astype(np.float64) ** 2 * std_px / self.focal_baseline).astype(np.float32)
        return StereoDepth(pictures[0], depth_m, std_m)

    def _disparity(self, left: UInt8, right: UInt8) -> Float32:
        """(H, W) px of disparity; -1 where left and right do not agree."""
        most = int(np.ceil(self.focal_baseline / NEAREST_M / _STEPS)) * _STEPS
        most = max(_STEPS, min(most, _MOST_DISPARITIES, self.camera.width // _STEPS * _STEPS))
        area = _BLOCK_PX**2
        matcher = cv2.StereoSGBM.create(
            minDisparity=0,
            numDisparities=most,
            blockSize=_BLOCK_PX,
            P1=8 * area,
            P2=32 * area,
            disp12MaxDiff=1,
            uniquenessRatio=5,
            speckleWindowSize=_SPECKLE_PX,
            speckleRange=_SPECKLE_RANGE,
            mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )
        # Columns on the left have partners beyond the right picture's border: add some of no match.
        bordered = [
            cv2.copyMakeBorder(each, 0, 0, most, 0, cv2.BORDER_REPLICATE) for each in (left, right)
        ]
        found = matcher.compute(*bordered)[:, most:].astype(np.float32) / _STEPS
        columns = np.arange(found.shape[1], dtype=np.float32)
        return np.where((found > 0) & (columns - found >= 0), found, -1).astype(np.float32)


def _without_specks(disparity: Float) -> Float32:
    """Disparities without small islands; -1 for none."""
    steps = np.rint(disparity * _STEPS).astype(np.int16)
    cv2.filterSpeckles(steps, -_STEPS, _SPECKLE_PX, _SPECKLE_RANGE * _STEPS)
    return np.where(steps > 0, disparity, -1).astype(np.float32)


def _grey(image: UInt8) -> UInt8:
    return image if image.ndim == 2 else cast("UInt8", cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def _refined(left: UInt8, right: UInt8, disparity: Float32) -> tuple[Float32, Float32]:
    """Refine disparities by least squares over blocks, in a few Gauss-Newton steps.

    Semi-global matching draws disparities to whole pixels, by up to 0.25 px. The grey values of a
    block follow L(x) = R(x - d) + c: the shift d and the difference c of the brightness are fitted,
    with Cauchy's weights against what is seen past an edge.

    Args:
        left: (H, W) grey of the rectified left picture.
        right: (H, W) grey of the right one.
        disparity: (H, W) px; not above 0 where there is no match.

    Returns:
        (H, W) px, refined where the blocks tell the shift, and (H, W) px standard deviations:
        infinite where there is no match.
    """
    matched: Bool = disparity > 0
    if not matched.any():
        return disparity, np.full(disparity.shape, np.inf, np.float32)
    seen, other = left.astype(np.float32), right.astype(np.float32)
    slope = cv2.Scharr(other, cv2.CV_32F, 1, 0, scale=1 / 32)
    height, width = disparity.shape
    columns, rows = np.meshgrid(
        np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    )
    found, noise, told = disparity, 1.0, np.ones_like(disparity)
    for _ in range(_REFINEMENTS):
        at = columns - found
        gradient = cv2.remap(slope, at, rows, cv2.INTER_LINEAR)
        off = seen - cv2.remap(other, at, rows, cv2.INTER_CUBIC)
        noise = max(float(np.median(np.abs(off[matched]))) / MEDIAN_ABS_NORMAL, _LEAST_NOISE)
        weight = np.where(matched, 1 / (1 + (off / (_CAUCHY * noise)) ** 2), 0.0).astype(np.float32)
        sums = [_block_sums(weight * part) for part in (1.0, gradient, off)]
        total, slopes, offs = sums[0] + np.float32(1e-6), sums[1], sums[2]
        told = _block_sums(weight * gradient * gradient) - slopes * slopes / total
        told = np.maximum(told, np.float32(1e-3))
        step = (slopes * offs / total - _block_sums(weight * gradient * off)) / told
        moved = found + np.clip(step, -_LARGEST_STEP_PX, _LARGEST_STEP_PX)
        near = matched & (np.abs(moved - disparity) < _FARTHEST_PX)
        found = np.where(near, moved, found).astype(np.float32)
    std_px = np.hypot(_FIT_FACTOR * noise / np.sqrt(told), MATCH_STD_PX)
    return found, np.where(matched, std_px, np.inf).astype(np.float32)


def _block_sums(values: Float) -> Float32:
    box = (_REFINED_BLOCK_PX, _REFINED_BLOCK_PX)
    return cast(
        "Float32", cv2.boxFilter(values.astype(np.float32), cv2.CV_32F, box, normalize=False)
    )
