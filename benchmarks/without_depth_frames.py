"""Simulated frames as inputs of measuring without depth: rigs with errors, ground, markers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Float, UInt8
from calib import PinholeCamera, project_points
from calib.directions import heading, unit
from edgetree.measure import CameraHeight, RigUncertainty

HEIGHT_STD, VERTICAL_STD_DEG, SLOPE_STD_DEG = 0.03, 1.0, 2.0
FOCAL_STD, PRINCIPAL_STD_SHARE = 0.01, 0.006
MARKER_ID, MARKER_M = 7, 0.16


@dataclass(frozen=True, eq=False)
class GivenRig:
    """What a user would say of a frame's camera, with errors of the stated deviations.

    Attributes:
        camera: The camera.
        up: (3,) the vertical.
        height: The camera's height above the ground.
        uncertainty: The deviations of camera and vertical.
    """

    camera: PinholeCamera
    up: Float
    height: CameraHeight
    uncertainty: RigUncertainty


def given_rig(
    image: dict[str, Any], trees: list[dict[str, Any]], rng: np.random.Generator
) -> GivenRig:
    """Draw a rig for a frame. The slope is that of the plane through the feet of its trees."""
    camera, up = PinholeCamera.from_dict(image["camera"]), np.array(image["up_camera"])
    slope_deg = ground_slope_deg(image, trees) + SLOPE_STD_DEG * rng.standard_normal(2)
    height_m = float(image["pose"]["height_m"])
    principal_px = PRINCIPAL_STD_SHARE * camera.width
    focal = 1 + FOCAL_STD * rng.standard_normal()
    moved = principal_px * rng.standard_normal(2)
    wrong = replace(
        camera,
        fx=camera.fx * focal,
        fy=camera.fy * focal,
        cx=camera.cx + moved[0],
        cy=camera.cy + moved[1],
        focal_std_px=FOCAL_STD * camera.fx,
        principal_std_px=principal_px,
    )
    return GivenRig(
        wrong,
        unit(up + np.radians(VERTICAL_STD_DEG) * rng.standard_normal(3)),
        CameraHeight(
            height_m * (1 + HEIGHT_STD * rng.standard_normal()),
            height_std_m=HEIGHT_STD * height_m,
            ahead_deg=float(np.clip(slope_deg[0], -45, 45)),
            right_deg=float(np.clip(slope_deg[1], -45, 45)),
            slope_std_deg=SLOPE_STD_DEG,
        ),
        RigUncertainty(0.0, principal_px, VERTICAL_STD_DEG, VERTICAL_STD_DEG),
    )


def ground_slope_deg(image: dict[str, Any], trees: list[dict[str, Any]]) -> Float:
    """(2,) slopes ahead and to the right of the plane below the camera nearest to all feet."""
    up = np.array(image["up_camera"])
    feet = np.array([np.array(t["position_m"]) - t["cut_height_m"] * up for t in trees])
    ahead = unit(heading(up))
    places = np.stack([feet @ ahead, feet @ np.cross(ahead, up)], 1)
    rise = feet @ up + image["pose"]["height_m"]
    gradient = np.linalg.solve(places.T @ places + 0.01 * np.eye(2), places.T @ rise)
    return np.degrees(np.arctan(gradient))


def with_marker(
    picture: UInt8, camera: PinholeCamera, bark_m: Float, up: Float, rng: np.random.Generator
) -> UInt8:
    """The picture with a marker of `MARKER_M` at a camera point (3,) on the bark of a stem."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    cells = 6
    printed = cv2.aruco.generateImageMarker(dictionary, MARKER_ID, 20 * cells)
    sheet = cv2.copyMakeBorder(printed, 20, 20, 20, 20, cv2.BORDER_CONSTANT, value=255)
    turn, nod, roll = np.radians([20.0, 6.0, 6.0]) * rng.standard_normal(3)
    towards = -unit(bark_m)
    right = unit(np.cross(up, towards))
    right = unit(right + turn * towards + roll * up)
    down = -unit(np.cross(towards, right) + nod * towards)
    half_m = MARKER_M / 2 * (1 + 2 / cells)
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half_m
    points_m = bark_m + corners[:, :1] * right + corners[:, 1:] * down
    there_px = (project_points(camera, points_m) - 0.5).astype(np.float32)
    side = sheet.shape[0]
    # OpenCV has whole numbers at the centres of pixels.
    here_px = np.array([[0, 0], [side, 0], [side, side], [0, side]], np.float32) - 0.5
    homography = cv2.getPerspectiveTransform(here_px, there_px)
    finer = 4
    size = (picture.shape[1], picture.shape[0])
    x0, y0 = np.floor(there_px.min(0)).astype(int) - 2
    x1, y1 = np.ceil(there_px.max(0)).astype(int) + 3
    zoom = np.array(
        [
            [finer, 0, -finer * x0 + (finer - 1) / 2],
            [0, finer, -finer * y0 + (finer - 1) / 2],
            [0, 0, 1],
        ]
    )
    area = (int(finer * (x1 - x0)), int(finer * (y1 - y0)))
    drawn = cv2.warpPerspective(sheet, zoom @ homography, area)
    cover = cv2.warpPerspective(np.full_like(sheet, 255), zoom @ homography, area)
    small = (int(x1 - x0), int(y1 - y0))
    drawn, cover = (
        cv2.resize(part, small, interpolation=cv2.INTER_AREA) for part in (drawn, cover)
    )
    result = picture.copy()
    left, top = max(x0, 0), max(y0, 0)
    right_px, bottom = min(x1, size[0]), min(y1, size[1])
    if left >= right_px or top >= bottom:
        return result
    part = (slice(top - y0, bottom - y0), slice(left - x0, right_px - x0))
    share = cover[part][..., None] / 255.0
    below = result[top:bottom, left:right_px]
    blended = below * (1 - share) + 0.85 * drawn[part][..., None] * share
    result[top:bottom, left:right_px] = np.clip(blended, 0, 255).astype(np.uint8)
    return result
