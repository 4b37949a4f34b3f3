"""Widths of stems in the picture, in pixels and as angles, which need no depth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from basetree.arrays import Bool, Float
from basetree.errors import InputError
from calib import PinholeCamera, pixels_to_rays, project_points
from calib.directions import unit
from edgetree.detections import TreeDetections
from edgetree.measure.estimates import Estimate, Failure, JsonValue, TreeMeasurement
from edgetree.measure.frame import DepthFrame
from edgetree.measure.inputs import checked_frame, direction
from edgetree.measure.keypoints import LEFT, RIGHT, Keypoints
from edgetree.measure.outline import trace_outline
from edgetree.measure.profile import StemProfile
from edgetree.measure.search_regions import find_regions
from edgetree.measure.settings import MeasureSettings

BREAST_HEIGHT, WIDEST, AT_KEYPOINTS = "breast height", "widest seen section", "diameter keypoints"
"""Places at which a width in the picture is taken."""

# A width is the median of this many neighbouring stations, so that a twig does not make it.
_STATIONS = 3
# A height is that of breast height within this, in m: half a step of a profile, and rounding.
_SAME_HEIGHT_M = 0.051


@dataclass(frozen=True, kw_only=True)
class PixelSize:
    """The size of a stem in the picture.

    Attributes:
        width_px: Width across the stem, in pixels of the picture.
        width_deg: The angle that this width fills as seen from the camera; None without a camera.
        width_at: Where it is taken: one of `BREAST_HEIGHT`, `WIDEST` and `AT_KEYPOINTS`.
        lean_in_picture_deg: Angle of the stem's middle line from the vertical in the picture,
            positive to the right: from the given vertical, or from the picture's own side.
    """

    width_px: Estimate
    width_deg: Estimate | None
    width_at: str
    lean_in_picture_deg: Estimate

    def to_dict(self) -> dict[str, JsonValue]:
        """A JSON-ready dictionary; standard deviations end with `_std` before the unit."""
        angle, lean = self.width_deg, self.lean_in_picture_deg
        return {
            "width_px": self.width_px.value,
            "width_std_px": self.width_px.std,
            "width_deg": None if angle is None else angle.value,
            "width_std_deg": None if angle is None else angle.std,
            "width_at": self.width_at,
            "lean_in_picture_deg": lean.value,
            "lean_in_picture_std_deg": lean.std,
        }


def pixel_sizes(
    trees: TreeDetections,
    camera: PinholeCamera | None,
    *,
    masks: Sequence[Bool] | Bool | None = None,
    up_camera: Float | None = None,
    measurements: Sequence[TreeMeasurement] | None = None,
    settings: MeasureSettings | None = None,
) -> list[PixelSize | Failure]:
    """The size of every tree in the picture.

    It is taken at breast height where the measurement tells where that is, else at the widest
    section that the mask shows, else between the diameter keypoints.

    Args:
        trees: The N trees.
        camera: Intrinsics of the picture; None if they are not known.
        masks: (N, H, W) bool masks that replace those of the trees.
        up_camera: (3,) direction away from gravity in camera coordinates, if it is given.
        measurements: One per tree, if they are measured.
        settings: Errors of keypoints and masks.

    Returns:
        The sizes, or why there is none.

    Raises:
        InputError: There is not one measurement per tree, masks or camera are of another size, or
            the vertical is not a valid direction.
    """
    if measurements is not None and len(measurements) != len(trees):
        raise InputError(
            f"there are {len(measurements)} measurements: expected {len(trees)}, one per tree"
        )
    up_camera = None if up_camera is None else direction(up_camera)
    if not len(trees):
        return []
    settings = (settings or MeasureSettings()).scaled(trees.error_factor)
    width, height = trees.image_width, trees.image_height
    # Only directions depend on the focal length, so that any will do for widths in pixels.
    any_camera = PinholeCamera(width, height, width, width, (width - 1) / 2, (height - 1) / 2)
    no_depth_m = np.zeros((height, width), np.float32)
    with np.errstate(all="ignore"):
        frame = checked_frame(trees, no_depth_m, camera or any_camera, masks, settings)
        seen = _Seen.of(frame, trees)
    found: list[PixelSize | Failure] = []
    for index in range(len(trees)):
        edges_px, place = seen.edges_px[index], seen.places[index]
        tree = None if measurements is None else measurements[index]
        breast_m = _at_breast_height(tree, settings.breast_height_m)
        if breast_m is not None and camera is not None:
            edges_px, place = project_points(camera, breast_m), BREAST_HEIGHT
        if not np.isfinite(edges_px).all():
            found.append(Failure("neither keypoints nor the mask show both edges of the stem"))
            continue
        lean = seen.lean(index, camera, up_camera)
        found.append(_size(edges_px, seen.std_px.item(index), place, camera, lean))
    return found


@dataclass(frozen=True, eq=False)
class _Seen:
    """What a picture shows of T stems.

    Attributes:
        edges_px: (T, 2, 2) left and right edge of the widest section; NaN where none is seen.
        std_px: (T,) standard deviations of an edge.
        places: Where the sections are.
        origin_px, along_px: (T, 2) a point on the middle line, and the unit vector up it.
        length_px: (T,) its seen length.
    """

    edges_px: Float
    std_px: Float
    places: list[str]
    origin_px: Float
    along_px: Float
    length_px: Float

    @classmethod
    def of(cls, frame: DepthFrame, trees: TreeDetections) -> _Seen:
        keypoints = Keypoints.from_detections(trees, frame.settings)
        regions = find_regions(frame, trees.boxes_px.astype(np.float64), keypoints)
        edges_px = np.where(
            keypoints.has_section[:, None, None], keypoints.xy_px[:, [LEFT, RIGHT]], np.nan
        )
        std_px = np.hypot(keypoints.std_px[:, LEFT, 0], keypoints.std_px[:, RIGHT, 0])
        std_px, places = std_px / math.sqrt(2), [AT_KEYPOINTS] * len(trees)
        if frame.masks is not None:
            outline = trace_outline(frame, regions, keypoints)
            regions = outline.regions
            points = regions.points(outline.edges_px[..., None])[..., 0, :]
            for index in range(len(trees)):
                both = np.flatnonzero(outline.valid[:, index].all(0))
                if not len(both):
                    continue
                widths = np.subtract(*outline.edges_px[::-1, index, both])
                edges_px[index] = points[:, index, both[_widest(widths)]]
                std_px[index], places[index] = outline.std_px[index], WIDEST
        return cls(
            edges_px,
            std_px,
            places,
            regions.origin_px,
            regions.along,
            np.subtract(regions.span_px[:, 1], regions.span_px[:, 0]),
        )

    def lean(self, index: int, camera: PinholeCamera | None, up_camera: Float | None) -> Estimate:
        """Angle of one middle line from the vertical in the picture, in degrees."""
        vertical = np.array([0.0, -1.0])
        if camera is not None and up_camera is not None:
            ray = pixels_to_rays(camera, self.origin_px[index])
            ends = project_points(camera, np.stack([ray, ray + _STEP * unit(up_camera)]))
            vertical = ends[1] - ends[0]
        x, y = self.along_px[index].tolist()
        turned = math.atan2(vertical[0] * y - vertical[1] * x, vertical[0] * x + vertical[1] * y)
        std = math.atan2(2 * self.std_px.item(index), max(self.length_px.item(index), 1.0))
        return Estimate(math.degrees(turned), math.degrees(std))


# A step along the vertical, as a share of the distance, that shows its direction in the picture.
_STEP = 1e-3


def _widest(widths: Float) -> int:
    """Number of the largest of (N,) widths, each the median of its neighbours and itself."""
    if len(widths) < _STATIONS:
        return int(np.argsort(widths)[len(widths) // 2])
    runs = np.lib.stride_tricks.sliding_window_view(widths, _STATIONS)
    return int(np.median(runs, axis=1).argmax()) + _STATIONS // 2


def _at_breast_height(tree: TreeMeasurement | None, height_m: float) -> Float | None:
    """(2, 3) camera points of the edges at breast height, if the profile of the tree has it."""
    if tree is None or not isinstance(tree.profile, StemProfile):
        return None
    profile = tree.profile
    nearest = int(np.abs(profile.height_m - height_m).argmin())
    apart_m = abs(float(profile.height_m[nearest]) - height_m)
    if profile.heights_from != "ground" or apart_m > _SAME_HEIGHT_M:
        return None
    return np.asarray(profile.edges_m[nearest])


def _size(
    edges_px: Float, std_px: float, place: str, camera: PinholeCamera | None, lean: Estimate
) -> PixelSize:
    """The size between two edges (2, 2) in the picture."""
    width_px = float(np.linalg.norm(edges_px[1] - edges_px[0]))
    width = Estimate(width_px, math.sqrt(2) * std_px)
    angle = None
    if camera is not None:
        left, right = unit(pixels_to_rays(camera, edges_px))
        value = math.degrees(math.acos(min(float(left @ right), 1.0)))
        share = math.hypot(width.std / max(width_px, 1e-6), camera.focal_std_px / camera.fx)
        angle = Estimate(value, value * share)
    return PixelSize(width_px=width, width_deg=angle, width_at=place, lean_in_picture_deg=lean)
