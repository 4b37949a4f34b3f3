"""The geometry of a cylinder seen from near, against intersections computed directly."""

import numpy as np
import pytest

from edgetree.measure.section import axis_frame, tangent_section

RADIUS_M, DISTANCE_M = 0.4, 1.7


def circle_depths(rays, along, centre):
    """Depths where rays first meet a cylinder, by the quadratic equation in space."""
    flat = rays - (rays @ along)[:, None] * along
    middle = centre - (centre @ along) * along
    a, b, c = (flat**2).sum(1), flat @ middle, middle @ middle - RADIUS_M**2
    return (b - np.sqrt(b**2 - a * c)) / a


@pytest.fixture
def leaning():
    """A frame, the axis point of a section 0.6 m up the axis, and the rays that graze it."""
    normal = np.array([0.9, 0.1, -0.3])
    frame = axis_frame(normal / np.linalg.norm(normal), np.array([0.2, -0.95, 0.1]))
    middle = 0.1
    away = np.cos(middle) * frame.away + np.sin(middle) * frame.across
    across = np.cos(middle) * frame.across - np.sin(middle) * frame.away
    centre = DISTANCE_M * away + 0.6 * frame.along
    sine = RADIUS_M / DISTANCE_M
    tangents = [
        centre - RADIUS_M * sine * away + side * RADIUS_M * np.sqrt(1 - sine**2) * across
        for side in (-1, 1)
    ]
    return frame, centre, [point / point[2] for point in tangents]


def test_a_frame_is_right_handed_and_looks_away(leaning):
    frame = leaning[0]
    axes = np.stack([frame.along, frame.across, frame.away])
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert frame.along[1] < 0
    assert frame.across[0] > 0
    assert frame.away[2] > 0
    tilted = frame.tilted(0.4)
    axes = np.stack([tilted.along, tilted.across, tilted.away])
    assert axes @ axes.T == pytest.approx(np.eye(3))
    assert np.degrees(np.arccos(tilted.along @ frame.along)) == pytest.approx(
        np.degrees(np.arctan(0.4))
    )
    assert tilted.along @ frame.away > 0


def test_grazing_rays_give_radius_and_centre(leaning):
    frame, centre, edges = leaning
    section = tangent_section(frame, *edges)
    assert DISTANCE_M * np.sin(section.half_angle_rad) == pytest.approx(RADIUS_M)
    assert DISTANCE_M * section.centre == pytest.approx(centre)
    rho = DISTANCE_M * section.front_share
    sine = np.sin(section.half_angle_rad)
    assert 2 * rho * sine / (1 - sine) == pytest.approx(2 * RADIUS_M)


def test_every_ray_between_the_edges_meets_the_front(leaning):
    frame, centre, edges = leaning
    section = tangent_section(frame, *edges)
    share = np.linspace(0.02, 0.98, 40)[:, None]
    rays = (
        (1 - share) * edges[0] + share * edges[1] + np.linspace(-0.3, 0.3, 40)[:, None] * [0, 1, 0]
    )
    offset, depth, height = section.look(rays)
    inside = np.abs(offset) < 1
    assert inside.sum() > 30
    expected = circle_depths(rays[inside], frame.along, centre)
    assert DISTANCE_M * depth[inside] == pytest.approx(expected)
    points = rays[inside] * expected[:, None]
    assert DISTANCE_M * height[inside] == pytest.approx(points @ frame.along)


def test_rays_beside_or_behind_see_nothing(leaning):
    frame, _, edges = leaning
    section = tangent_section(frame, *edges)
    outwards = np.stack([2 * edges[0] - edges[1], 2 * edges[1] - edges[0], -edges[0] - edges[1]])
    offset, depth, _ = section.look(outwards)
    assert (np.abs(offset[:2]) > 1).all()
    assert depth.tolist() == [0.0, 0.0, 0.0]
