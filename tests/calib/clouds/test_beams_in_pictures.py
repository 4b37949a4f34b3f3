"""A cloud in a camera's picture: places, what is hidden, and transforms that are turned round."""

import numpy as np
import pytest

from calib import CloudError, PinholeCamera, RigidTransform
from calib.clouds import PointCloud, depth_of_beams, fill_between

CAMERA = PinholeCamera(640, 480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)
# From a level scanner (x ahead, y left, z up) to a level camera.
AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
DOWN = np.radians(np.arange(-15.0, 15.1, 1.0))
LEFT = np.radians(np.arange(-25.0, 25.0, 0.2))


def scan(ranges_m) -> np.ndarray:
    """Points of a scanner with 31 rings; `ranges_m` gives the range of unit directions (N, 3)."""
    up, left = (part.ravel() for part in np.meshgrid(DOWN, LEFT, indexing="ij"))
    rays = np.stack([np.cos(up) * np.cos(left), np.cos(up) * np.sin(left), np.sin(up)], -1)
    return rays * ranges_m(rays)[:, None]


def post_before_wall(rays: np.ndarray) -> np.ndarray:
    """A post of 0.3 m at 4 m, and a wall at 9 m."""
    is_post = np.abs(rays[:, 1] / rays[:, 0]) < 0.15 / 4
    return np.where(is_post, 4.0, 9.0) / rays[:, 0]


def test_beams_keep_their_place_and_depth():
    points = scan(lambda rays: 5.0 / rays[:, 0])
    depth = depth_of_beams(PointCloud(points), CAMERA, RigidTransform(AXES, np.zeros(3)))
    expected = np.stack([-points[:, 1] / 5 * 500 + 320, -points[:, 2] / 5 * 500 + 240], -1)
    columns, rows = np.floor(expected).astype(int).T
    inside = (columns >= 0) & (columns < 640) & (rows >= 0) & (rows < 480)
    assert np.count_nonzero(depth.depth_m) == len(
        set(zip(columns[inside], rows[inside], strict=True))
    )
    assert depth.depth_m[rows[inside], columns[inside]] == pytest.approx(5.0, abs=1e-5)
    assert depth.spacing.across_px == pytest.approx(1.75, abs=0.2)
    assert depth.spacing.down_px == pytest.approx(9.2, abs=0.5)


def test_beams_behind_a_post_are_not_given_to_it():
    # From half a metre beside the scanner, the post covers wall that the scanner sees past it.
    cloud = PointCloud(scan(post_before_wall))
    aside = RigidTransform(AXES, [-0.5, 0.0, 0.0])
    depth = depth_of_beams(cloud, CAMERA, aside)
    low, high = (int(320 + 500 * (x - 0.5) / 4) for x in (-0.13, 0.13))
    rows = slice(115, 365)  # within the rings, whose ends have no beam beyond them
    on_post = depth.depth_m[rows, low:high]
    assert np.count_nonzero(on_post) > 100
    assert on_post.max() < 5.0
    everything = np.count_nonzero(depth.depth_m > 8)
    assert depth.hidden > 50
    assert everything > 3000


def test_gaps_are_closed_on_one_surface_alone():
    depth = depth_of_beams(
        PointCloud(scan(post_before_wall)), CAMERA, RigidTransform(AXES, np.zeros(3))
    )
    filled = fill_between(depth.depth_m, depth.spacing)
    inner = filled[120:360, 160:480]
    assert np.count_nonzero(depth.depth_m[120:360, 160:480]) < 0.1 * inner.size
    assert np.count_nonzero(inner) > 0.9 * inner.size
    values = inner[inner > 0]
    assert (np.minimum(np.abs(values - 4), np.abs(values - 9)) < 0.01).all()


def test_an_inverse_transform_is_named():
    right = RigidTransform(AXES, [0.2, 0.3, -0.1])
    cloud = PointCloud(scan(lambda rays: 5.0 / rays[:, 0]))
    with pytest.raises(CloudError, match=r"with the inverse of the transform .* turn it round"):
        depth_of_beams(cloud, CAMERA, right.inverse())


def test_missing_axes_are_named():
    cloud = PointCloud(scan(lambda rays: 5.0 / rays[:, 0]))
    with pytest.raises(CloudError, match="may lack the rotation between their axes"):
        depth_of_beams(cloud, CAMERA, RigidTransform.identity())


def test_a_cloud_in_millimetres_is_refused():
    cloud = PointCloud(1000 * scan(lambda rays: 5.0 / rays[:, 0]))
    with pytest.raises(CloudError, match=r"5000 m away: expected metres"):
        depth_of_beams(cloud, CAMERA, RigidTransform(AXES, np.zeros(3)))


def test_a_folding_lens_brings_nothing_from_beside_the_picture():
    lens = (-0.3, 0.0, 0.0, 0.0)
    camera = PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5, lens)
    ahead = [[3.0, y / 20, z / 20] for y in range(-20, 20) for z in range(-20, 20)]
    aside = [[1.0, 1.85 + y / 200, z / 200] for y in range(20) for z in range(-20, 20)]
    extrinsic = RigidTransform(AXES, np.zeros(3))
    alone = depth_of_beams(PointCloud(ahead), camera, extrinsic)
    both = depth_of_beams(PointCloud(ahead + aside), camera, extrinsic)
    np.testing.assert_array_equal(alone.depth_m > 0, both.depth_m > 0)
