"""Images given to the detector are converted as documented, or rejected with an error."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import calib
from basetree.errors import InputError
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import FakeSession

Trees = dict[str, NDArray[np.float32]]

BAD_IMAGES = [
    ("rgb", np.zeros((9, 9), np.uint8), r"uint8 \(9, 9\): expected uint8 \(H, W, 3\) BGR"),
    ("rgb", np.zeros((9, 9, 4), np.uint8), r"\(9, 9, 4\): expected uint8 \(H, W, 3\)"),
    ("rgb", np.zeros((3, 9, 9), np.uint8), r"\(3, 9, 9\): expected uint8 \(H, W, 3\)"),
    ("rgb", np.zeros((1, 9, 9, 3), np.uint8), r"\(1, 9, 9, 3\): expected uint8 \(H, W, 3\)"),
    ("rgb", np.zeros((9, 9, 3), np.float32), r"float32 .*expected uint8"),
    ("rgb", np.zeros((9, 9, 3), np.uint16), r"uint16 .*expected uint8"),
    ("rgb", np.zeros((9, 9, 3), object), r"object .*expected uint8"),
    ("rgb", np.zeros((0, 9, 3), np.uint8), "expected at least one pixel"),
    ("rgb", np.broadcast_to(np.uint8(0), (10**6, 10**6, 3)), "expected at most 32767 px a side"),
    ("rgb", None, "image is a NoneType: expected a plain numpy array"),
    ("rgb", "tree.jpg", "image is a str: expected a plain numpy array"),
    ("rgb", [[[0, 0, 0]]], "image is a list: expected a plain numpy array"),
    ("depth", np.zeros((9, 9), np.uint16), r"uint16 .*expected float \(H, W\) metres or uint8"),
    ("depth", np.zeros((9, 9), np.uint16), r"become metres by .*astype\(numpy.float32\) / 1000"),
    ("depth", np.full((9, 9), 3500.0, np.float32), r"median of 3500: expected metres; .*millimet"),
    ("depth", np.zeros((9, 9, 3), np.uint8), r"\(9, 9, 3\): expected float"),
    ("depth", np.zeros((9, 9), complex), r"complex128 .*expected float"),
    ("depth", np.zeros((9, 0), np.float32), "expected at least one pixel"),
    ("depth", np.ma.masked_less(np.ones((9, 9)), 0.5), "MaskedArray: expected a plain numpy"),
    ("depth", np.full((9, 9), -1.5, np.float32), r"has negative depths, -1\.5 m the lowest"),
]


@pytest.fixture
def detector_of(
    rgb_manifest: Manifest, depth_manifest: Manifest, two_trees: Trees
) -> Callable[[str], TreeDetector]:
    manifests = {"rgb": rgb_manifest, "depth": depth_manifest}
    return lambda modality: TreeDetector(FakeSession.with_trees(manifests[modality], **two_trees))


def _seen(detector: TreeDetector, image: NDArray[Any]) -> NDArray[np.uint8]:
    """The model's input for an image."""
    detector.detect(image)
    session = detector.session
    assert isinstance(session, FakeSession)
    return session.inputs["image"][0]


@pytest.mark.parametrize(("modality", "image", "message"), BAD_IMAGES)
def test_invalid_images_are_rejected_and_the_detector_stays_usable(
    detector_of: Callable[[str], TreeDetector], modality: str, image: Any, message: str
) -> None:
    detector = detector_of(modality)
    good = np.zeros((384, 640, 3) if modality == "rgb" else (384, 640), np.uint8)
    with pytest.raises(InputError, match=message) as caught:
        detector.detect(image)
    assert "\n" not in str(caught.value)
    with pytest.raises(InputError, match=r"images\[1\] "):
        detector.detect_batch([good, image])
    assert len(detector.detect(good)) == 1


def test_depth_is_encoded_as_in_the_manifest(
    depth_manifest: Manifest, detector_of: Callable[[str], TreeDetector]
) -> None:
    detector = detector_of("depth")
    depth_m = np.random.default_rng(1).uniform(0, 25, (384, 640)).astype(np.float32)
    depth_m[:50] = 0.0
    assert depth_manifest.depth_encoding is not None
    encoding = calib.DepthEncoding.from_dict(dict(depth_manifest.depth_encoding))
    encoded = calib.encode_depth(depth_m, encoding)
    for same in (depth_m, encoded, depth_m.astype(np.float64), depth_m.astype(">f4")):
        np.testing.assert_array_equal(_seen(detector, same), encoded)


@pytest.mark.parametrize("marker", [np.nan, np.inf, -np.inf, -0.0, 1e300])
def test_zero_nan_and_infinity_mean_no_reading(
    detector_of: Callable[[str], TreeDetector], marker: float
) -> None:
    detector = detector_of("depth")
    depth_m = np.full((384, 640), 3.0)
    depth_m[100:200] = 0.0
    expected = _seen(detector, depth_m).copy()
    depth_m[100:200] = marker
    np.testing.assert_array_equal(_seen(detector, depth_m), expected)


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_non_contiguous_images_give_the_same_input(
    detector_of: Callable[[str], TreeDetector], modality: str
) -> None:
    detector = detector_of(modality)
    rng = np.random.default_rng(0)
    shape = (720, 1280, 3) if modality == "rgb" else (720, 1280)
    image = rng.integers(0, 256, shape, np.uint8) if modality == "rgb" else rng.uniform(0, 9, shape)
    expected = _seen(detector, image).copy()
    wide = np.zeros((1000, 1400, *shape[2:]), image.dtype)
    wide[100:820, 60:1340] = image
    read_only = image.copy()
    read_only.flags.writeable = False
    views = {
        "part of a larger one": wide[100:820, 60:1340],
        "upside down": image[::-1].copy()[::-1],
        "mirrored": image[:, ::-1].copy()[:, ::-1],
        "columns first": np.asfortranarray(image),
        "read-only": read_only,
    }
    if modality == "rgb":
        views["RGB turned to BGR"] = image[..., ::-1].copy()[..., ::-1]
    for name, view in views.items():
        np.testing.assert_array_equal(_seen(detector, view), expected, err_msg=name)


def test_the_image_is_not_modified(detector_of: Callable[[str], TreeDetector]) -> None:
    depth_m = np.array([[1.0, np.nan], [0.0, 25.0]], np.float32)
    kept = depth_m.copy()
    detector_of("depth").detect(depth_m)
    np.testing.assert_array_equal(depth_m, kept)
