"""The required range of conditions, with exact keypoints and depth, and with masks and depth.

Distances of 1 to 10 m, diameters of 5 to 80 cm, leans of up to 30 degrees and slopes of up to 30
degrees, anywhere in the image.
"""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from edgetree.measure.constants.stems import TAPER_PER_M

# Diameter and distance in m, column and row of the section in px; lean and its direction, slope and
# uphill direction in degrees.
CORNERS = [
    (0.05, 1.0, 276, 375, 0, 0, 0, 90),
    (0.05, 1.0, 1100, 300, 30, 150, 10, 200),
    (0.05, 10.0, 219, 282, 0, 0, 0, 90),
    (0.05, 10.0, 640, 342, 30, 184, 0, 90),
    (0.8, 1.0, 640, 230, 0, 0, 0, 90),
    (0.8, 1.0, 760, 330, 30, 184, 0, 90),
    (0.8, 10.0, 950, 387, 0, 0, 30, 270),
    (0.8, 10.0, 350, 388, 30, 174, 0, 90),
    (0.3, 5.0, 60, 80, 10, 90, 0, 90),
    (0.3, 5.0, 1180, 620, 10, 270, 0, 90),
    (0.3, 5.0, 60, 640, 0, 0, 30, 0),
    (0.3, 5.0, 1200, 100, 0, 0, 30, 180),
]
BETWEEN = [
    (0.133, 6.3, 904, 201, 18, 288, 27, 312),
    (0.071, 5.2, 862, 226, 0, 29, 30, 322),
    (0.091, 1.3, 249, 180, 13, 124, 22, 168),
    (0.617, 7.3, 935, 263, 27, 6, 9, 57),
    (0.792, 5.1, 1023, 474, 26, 19, 15, 12),
    (0.388, 2.8, 1147, 97, 4, 215, 26, 322),
    (0.113, 7.5, 826, 355, 8, 307, 29, 78),
    (0.120, 3.3, 525, 560, 11, 338, 15, 122),
    (0.313, 7.2, 1094, 528, 17, 333, 14, 53),
    (0.292, 2.4, 90, 358, 16, 28, 7, 219),
    (0.150, 9.2, 723, 129, 2, 31, 28, 202),
    (0.723, 9.2, 523, 480, 25, 24, 22, 290),
    (0.333, 2.3, 961, 338, 25, 17, 10, 288),
    (0.383, 3.6, 194, 539, 19, 149, 21, 199),
    (0.439, 6.7, 819, 601, 21, 271, 3, 107),
    (0.151, 1.4, 117, 330, 26, 88, 0, 10),
    (0.182, 7.5, 663, 321, 2, 131, 23, 237),
    (0.158, 8.1, 338, 70, 30, 9, 24, 215),
]
STANDS = pytest.mark.parametrize("position", CORNERS + BETWEEN)


@pytest.fixture(scope="module")
def standing(scene, pole):
    """Build a scene whose section is at a given point of the image."""

    @cache
    def build(diameter_m, distance_m, column, row, lean, towards, slope, uphill):
        camera_height_m, section_m, focal_px = min(0.5 + 0.5 * distance_m, 1.5), 0.4, 700.0
        bearing = np.arctan2(column - 640, focal_px)
        right_m, ahead_m = distance_m * np.sin(bearing), distance_m * np.cos(bearing)
        towards_up = np.radians(uphill)
        rise_m = np.tan(np.radians(slope)) * (
            right_m * np.cos(towards_up) + ahead_m * np.sin(towards_up)
        )
        below = np.arctan2(camera_height_m - rise_m - section_m, ahead_m)
        pitch_deg = np.degrees(below - np.arctan2(row - 360, focal_px))
        return scene(
            pole(diameter_m, right_m, ahead_m, lean, towards, section_m=section_m),
            camera_height_m=camera_height_m,
            pitch_deg=pitch_deg,
            slope_deg=slope,
            uphill_deg=uphill,
        )

    return build


@STANDS
def test_keypoints_and_depth_give_the_diameter_and_the_cut(standing, exact, position):
    stand = standing(*position)
    stem = stand.poles[0]
    tree = stand.measure(settings=replace(exact, keypoint_std_px=0.02))
    assert tree.diameter_m.value == pytest.approx(stem.diameter_m, rel=0.005)
    assert tree.cut_height_m.value == pytest.approx(stand.cut_height_m(stem), abs=0.01)
    # The keypoints do not tell that a pole has no taper, by which the bark of stems recedes.
    recedes_deg = np.degrees(TAPER_PER_M * stem.diameter_m / 2)
    assert tree.inclination_deg.value == pytest.approx(stem.lean_deg, abs=0.2 + recedes_deg)
    assert tree.cut_point_m.xyz_m == pytest.approx(stand.cut_point(stem), abs=0.012)


@STANDS
def test_masks_and_depth_alone_give_the_diameter(standing, position):
    stand = standing(*position)
    stem = stand.poles[0]
    three_tenths_px = 0.3 * stand.axis_point(stem, stem.section_m)[2] / stand.camera.fx
    tree = stand.measure_mask()
    allowed_m = max(0.005 * stem.diameter_m, three_tenths_px)
    assert tree.diameter_m.value == pytest.approx(stem.diameter_m, abs=allowed_m)
    assert tree.inclination_deg.value == pytest.approx(stem.lean_deg, abs=0.5)
