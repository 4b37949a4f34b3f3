"""The words in names of topics and frames, and what they tell."""

from __future__ import annotations

import pytest

from edgetree.sources.bags.topic_words import depth_by_name, is_aligned, is_rectified


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("/camera/aligned_depth_to_color/image_raw", True),
        ("/camera/depth_registered/image_rect", True),
        ("/camera/depthRegistered/image", True),
        ("/camera/depth_unregistered/image", False),
        ("/camera/unaligned/depth", False),
        ("/camera/misaligned_depth/image", False),
        ("/camera/not_registered/depth", False),
        ("/camera/depth/image_raw", False),
    ],
)
def test_names_of_aligned_depth(topic: str, expected: bool) -> None:
    assert is_aligned(topic) is expected


@pytest.mark.parametrize(
    ("topic", "expected"),
    [
        ("/cam/image_rect", True),
        ("/cam/image_rect_color", True),
        ("/cam/image_rectified/compressed", True),
        ("/cam/imageRectified", True),
        ("/rectified/image", True),
        ("/cam/image_undistorted", True),
        ("/cam/undistort/image", True),
        ("/cam/image_raw", False),
        ("/cam/image_unrectified", False),
        ("/cam/not_rectified/image", False),
        ("/cam/distorted", False),
        ("/direct/image", False),
        ("/correct_color/image", False),
        ("/rectangle/image", False),
    ],
)
def test_names_of_rectified_pictures(topic: str, expected: bool) -> None:
    assert is_rectified(topic) is expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("/camera/depth/image_raw", "depth"),
        ("/device_0/sensor_0/Depth_0/image/data", "depth"),
        ("/camera/aligned_depth_to_infra1/image_raw", "depth"),
        ("/thermal/depth/image", "depth"),
        ("/camera/depthmap", "depth"),
        ("/oak/stereo/image_raw", "depth"),
        ("/oak/stereo/left/image_raw", "other"),
        ("/zed/left/depth", "depth"),
        ("/thermal/image_raw", "other"),
        ("/boson640/image", "other"),
        ("/ir/image", "other"),
        ("/nir/image", "other"),
        ("/camera/infra1/image_rect_raw", "other"),
        ("/device_0/sensor_0/Infrared_1/image/data", "other"),
        ("/camera/depth/confidence", "other"),
        ("/camera/depth_confidence/image", "other"),
        ("/lwir_camera/image", "other"),
        ("/camera/stereo/disparity", "other"),
        ("/ouster/range_image", "other"),
        ("/depthai/image", ""),
        ("/camera/image_raw", ""),
        ("/first/circle/image", ""),
        ("", ""),
    ],
)
def test_what_a_name_says_of_depth(name: str, expected: str) -> None:
    assert depth_by_name([name])[0] == expected


def test_the_topic_tells_before_the_frame() -> None:
    assert depth_by_name(["/camera/image", "depth_optical_frame"]) == ("depth", "depth")
    assert depth_by_name(["/thermal/image", "depth_optical_frame"]) == ("other", "thermal")
    assert depth_by_name(["/stereo/image", "thermal_frame"]) == ("other", "thermal")
