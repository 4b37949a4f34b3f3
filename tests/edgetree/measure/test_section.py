"""Cross-section geometry, compared with ray-cylinder intersections in space."""

import numpy as np
import pytest

from edgetree.measure.section import Sections, StemAxes, axes_in_planes

RADIUS_M, DISTANCE_M = 0.4, 1.7
HALF_RAD = np.arcsin(RADIUS_M / DISTANCE_M)
# Bearings of the stems' middles, and heights of the sections along the axes.
MIDDLE_RAD, UP_AXIS_M = np.array([0.1, -0.2]), np.array([0.6, -0.3])


def circle_depths(rays, along, centre):
    """Depth at which rays first meet a cylinder, from the quadratic equation."""
    flat = rays - (rays @ along)[:, None] * along
    middle = centre - (centre @ along) * along
    a, b, c = (flat**2).sum(1), flat @ middle, middle @ middle - RADIUS_M**2
    return (b - np.sqrt(b**2 - a * c)) / a


def axes_of(frames: StemAxes, index: int):
    return np.stack([frames.along[index], frames.across[index], frames.away[index]])


@pytest.fixture
def leaning():
    """Two stems: axes, centres of the sections (2, 3), tangent rays (2, 2, 3) and sections."""
    normals = np.array([[0.9, 0.1, -0.3], [-0.95, 0.2, 0.1]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    frames = axes_in_planes(
        normals, np.array([0.2, -0.95, 0.1]) / np.linalg.norm([0.2, -0.95, 0.1])
    )
    cos, sin = np.cos(MIDDLE_RAD)[:, None], np.sin(MIDDLE_RAD)[:, None]
    away = cos * frames.away + sin * frames.across
    across = cos * frames.across - sin * frames.away
    centres = DISTANCE_M * away + UP_AXIS_M[:, None] * frames.along
    tangents = np.stack(
        [
            centres - RADIUS_M * (np.sin(HALF_RAD) * away - side * np.cos(HALF_RAD) * across)
            for side in (-1, 1)
        ],
        axis=1,
    )
    sections = Sections(frames, MIDDLE_RAD, np.full(2, HALF_RAD), UP_AXIS_M / DISTANCE_M)
    return frames, centres, tangents / tangents[..., 2:], sections


def test_axes_are_right_handed_and_point_away(leaning):
    frames = leaning[0]
    tilted = frames.tilted(np.array([0.4, -0.1]))
    for index, tangent in enumerate((0.4, -0.1)):
        for some in (frames, tilted):
            axes = axes_of(some, index)
            assert axes @ axes.T == pytest.approx(np.eye(3))
            assert np.linalg.det(axes) == pytest.approx(1.0)
        assert frames.along[index, 1] < 0
        assert frames.across[index, 0] > 0
        assert frames.away[index, 2] > 0
        turned = np.arccos(tilted.along[index] @ frames.along[index])
        assert np.tan(turned) == pytest.approx(abs(tangent))
        assert np.sign(tilted.along[index] @ frames.away[index]) == np.sign(tangent)


def test_grazing_rays_lie_half_the_angle_beside_the_middle(leaning):
    frames, centres, edges, sections = leaning
    bearings, _ = frames.bearing_and_slope(edges)
    assert bearings.mean(1) == pytest.approx(MIDDLE_RAD)
    assert np.diff(bearings, axis=1)[:, 0] / 2 == pytest.approx(np.full(2, HALF_RAD))
    assert DISTANCE_M * sections.centre == pytest.approx(centres)
    front_m = DISTANCE_M * sections.front_ratio
    sine = np.sin(HALF_RAD)
    assert 2 * front_m * sine / (1 - sine) == pytest.approx(np.full(2, 2 * RADIUS_M))


def test_rays_between_the_edges_meet_the_front(leaning):
    frames, centres, edges, sections = leaning
    share = np.linspace(0.02, 0.98, 40)[:, None]
    climb = np.linspace(-0.3, 0.3, 40)[:, None] * [0, 1, 0]
    rays = (1 - share) * edges[:, :1] + share * edges[:, 1:] + climb
    view = sections.view(rays)
    for index in range(2):
        inside = view.depth_ratio[index] > 0
        assert inside.sum() > 30
        assert (np.abs(view.offset[index][inside]) < 1).all()
        along, shown = frames.along[index], rays[index][inside]
        expected = circle_depths(shown, along, centres[index])
        assert DISTANCE_M * view.depth_ratio[index][inside] == pytest.approx(expected)
        heights = (shown * expected[:, None]) @ along
        assert DISTANCE_M * view.height_ratio[index][inside] == pytest.approx(heights)


def test_the_slope_is_how_the_depth_changes_with_the_half_angle(leaning):
    frames, _, edges, sections = leaning
    share = np.linspace(0.1, 0.9, 9)[:, None]
    rays = (1 - share) * edges[:, :1] + share * edges[:, 1:]
    step = 1e-6
    wider = Sections(frames, MIDDLE_RAD, sections.half_rad + step, sections.height_ratio)
    change = (wider.view(rays).depth_ratio - sections.view(rays).depth_ratio) / step
    assert sections.view(rays).depth_ratio_slope == pytest.approx(change, rel=1e-3)


def test_rays_that_miss_the_stem_give_zero(leaning):
    _, _, edges, sections = leaning
    left, right = edges[:, 0], edges[:, 1]
    outwards = np.stack([2 * left - right, 2 * right - left, -left - right], 1)
    view = sections.view(outwards)
    assert (np.abs(view.offset[:, :2]) > 1).all()
    assert not view.depth_ratio.any()
    assert not view.depth_ratio_slope.any()
