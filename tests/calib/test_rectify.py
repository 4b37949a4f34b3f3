"""Removing the distortion from images and depth maps."""

from dataclasses import replace

import numpy as np
import pytest

from calib import CameraError, PinholeCamera, depth_to_points, pixels_to_rays, rectify

PLAIN = PinholeCamera(320, 240, 180.0, 181.0, 158.0, 121.0, focal_std_px=0.5)
BARREL = replace(PLAIN, distortion=(-0.3, 0.1, 1e-3, -2e-3))
FISHEYE = replace(PLAIN, distortion=(-0.03, -0.01, 0.007, -0.002), distortion_model="fisheye")


def smooth_image(camera: PinholeCamera) -> np.ndarray:
    """An image whose grey value depends on the ray's direction alone."""
    points = depth_to_points(camera, np.ones((camera.height, camera.width), np.float32))
    greys = 127 + 60 * np.sin(25 * points[..., 0]) + 60 * np.cos(25 * points[..., 1])
    return np.rint(greys).astype(np.uint8)


@pytest.mark.parametrize("camera", [PLAIN, BARREL, FISHEYE])
@pytest.mark.parametrize("focal_scale", [1.0, 1.3])
def test_a_rectified_image_matches_the_undistorted_camera(
    camera: PinholeCamera, focal_scale: float
) -> None:
    straight = rectify(camera, focal_scale)
    assert straight.camera.distortion == ()
    assert straight.camera.distortion_model == "radtan"
    assert straight.camera.fx == camera.fx * focal_scale
    assert straight.camera.focal_std_px == 0.5 * focal_scale
    image = straight.image(smooth_image(camera))
    seen = straight.map_x > -1
    miss = np.abs(image.astype(int) - smooth_image(straight.camera))
    assert seen.mean() > 0.9
    assert miss[2:-2, 2:-2].max() <= 2


def test_a_smaller_focal_length_shows_more_and_pads_with_0() -> None:
    straight = rectify(FISHEYE, 0.4)
    image = straight.image(np.full((240, 320), 200, np.uint8))
    assert image[120, 160] == 200
    assert image[0, 0] == 0
    corner = pixels_to_rays(FISHEYE, [0.5, 0.5])
    assert np.abs(corner[0]) < np.abs(pixels_to_rays(straight.camera, [0.5, 0.5])[0])


def test_nothing_is_shown_twice_with_a_non_invertible_distortion() -> None:
    folding = PinholeCamera(240, 240, 183.0, 183.0, 119.5, 119.5, (-0.35, 0.0, 0.0, 0.0))
    straight = rectify(folding, 0.3)
    seen = straight.image(np.full((240, 240), 200, np.uint8)) > 0
    points = depth_to_points(straight.camera, np.ones((240, 240), np.float32))
    radius = np.hypot(points[..., 0], points[..., 1])
    fold = np.sqrt(1 / 1.05)  # where r - 0.35 r^3 is largest
    assert seen[radius < 0.97 * fold].all()
    assert not seen[radius > 1.03 * fold].any()


@pytest.mark.parametrize("camera", [BARREL, FISHEYE])
def test_depth_is_taken_from_the_nearest_pixel(camera: PinholeCamera) -> None:
    depth_m = np.full((240, 320), 3.0, np.float32)
    depth_m[:, 100:] = 9.0
    straight = rectify(camera)
    result = straight.depth(depth_m)
    assert result.dtype == np.float32
    assert set(np.unique(result)) <= {0.0, 3.0, 9.0}
    rays = pixels_to_rays(camera, [[100.0, 121.5]])
    edge_px = rays[0, 0] * straight.camera.fx + straight.camera.cx + 0.5
    edge = np.argmax(result[121] == 9.0)
    assert abs(edge - edge_px) <= 1


def test_images_of_another_size_are_rejected() -> None:
    straight = rectify(BARREL)
    with pytest.raises(CameraError, match="the image is 6x4 px: expected the camera's 320x240"):
        straight.image(np.zeros((4, 6, 3), np.uint8))
    with pytest.raises(CameraError, match="the depth map is 6x4 px: expected the camera's 320x240"):
        straight.depth(np.zeros((4, 6), np.float32))
    with pytest.raises(CameraError, match="focal_scale is 0: expected a positive number"):
        rectify(BARREL, 0)
