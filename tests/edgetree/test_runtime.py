"""The detector gives the model the right bytes, and brings its pixels back to the image's."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import calib
from edgetree.errors import InputError, ModelFileError
from edgetree.manifest import Manifest, standard_input, standard_outputs
from edgetree.runtime import TreeDetector, default_model
from edgetree.session import FakeSession

Trees = dict[str, NDArray[np.float32]]


def _image(width: int = 1280, height: int = 720) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)


@pytest.mark.parametrize(("width", "height", "factor"), [(1280, 720, 2), (640, 384, 1)])
def test_pixels_come_back_to_the_image(
    rgb_manifest: Manifest, two_trees: Trees, width: int, height: int, factor: float
) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    trees = TreeDetector(session, score_threshold=0.01).detect(_image(width, height))
    assert trees.keypoints_px is not None
    np.testing.assert_allclose(trees.boxes_px, two_trees["boxes"] * factor, atol=1e-3)
    keypoints = two_trees["keypoints"]
    np.testing.assert_allclose(trees.keypoints_px[..., :2], keypoints[..., :2] * factor, atol=1e-3)
    np.testing.assert_array_equal(trees.keypoints_px[..., 2], keypoints[..., 2])
    assert (trees.image_width, trees.image_height) == (width, height)


def test_a_tall_image_comes_back_too(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    trees = TreeDetector(session).detect(_image(600, 960))
    np.testing.assert_allclose(trees.boxes_px[0], two_trees["boxes"][0] * 2.5, atol=1e-3)


def test_what_lies_in_the_padding_is_left_out(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    # A tall image fills only the left 240 pixels of the input; the second tree starts at 400.
    trees = TreeDetector(session, score_threshold=0.01).detect(_image(600, 960))
    assert len(trees) == 1


def test_the_model_sees_the_cameras_bytes(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    image = _image(640, 360)
    TreeDetector(session).detect(image)
    seen = session.inputs["image"]
    assert seen.dtype == np.uint8
    assert seen.shape == (1, 384, 640, 3)
    np.testing.assert_array_equal(seen[0, :360], image)
    assert (seen[0, 360:] == 114).all()


def test_depth_is_encoded_as_the_manifest_says(depth_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(depth_manifest, **two_trees)
    detector = TreeDetector(session)
    depth_m = np.random.default_rng(1).uniform(0, 25, (384, 640)).astype(np.float32)
    depth_m[:50] = 0.0
    assert depth_manifest.depth_encoding is not None
    encoding = calib.DepthEncoding.from_dict(dict(depth_manifest.depth_encoding))
    encoded = calib.encode_depth(depth_m, encoding)
    detector.detect(depth_m)
    np.testing.assert_array_equal(session.inputs["image"][0], encoded)
    detector.detect(encoded)
    np.testing.assert_array_equal(session.inputs["image"][0], encoded)
    detector.detect(depth_m.astype(np.float64))
    np.testing.assert_array_equal(session.inputs["image"][0], encoded)


def test_the_threshold_and_the_count_choose_the_rows(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    assert len(TreeDetector(session).detect(_image())) == 1
    assert len(TreeDetector(session, score_threshold=0.3).detect(_image())) == 2
    none = {name: rows[:0] for name, rows in two_trees.items()}
    empty = FakeSession.with_trees(rgb_manifest, **none)
    assert len(TreeDetector(empty, score_threshold=0.0).detect(_image())) == 0


def test_a_model_of_boxes_alone_works(rgb_manifest: Manifest, two_trees: Trees) -> None:
    outputs = standard_outputs(20, keypoints=False, masks=False)
    manifest = dataclasses.replace(rgb_manifest, outputs=outputs, keypoint_names=())
    session = FakeSession.with_trees(manifest, two_trees["boxes"], two_trees["scores"])
    trees = TreeDetector(session).detect(_image())
    assert trees.keypoints_px is None
    assert trees.masks is None


@pytest.mark.parametrize(
    ("modality", "image", "message"),
    [
        ("rgb", np.zeros((9, 9), np.uint8), r"uint8 \(9, 9\): expected uint8 \(H, W, 3\) BGR"),
        ("rgb", np.zeros((9, 9, 4), np.uint8), r"\(9, 9, 4\): expected uint8 \(H, W, 3\)"),
        ("rgb", np.zeros((9, 9, 3), np.float32), r"float32 .*expected uint8"),
        ("rgb", np.zeros((0, 9, 3), np.uint8), "expected at least one pixel"),
        ("depth", np.zeros((9, 9), np.uint16), r"uint16 .*expected float \(H, W\) metres or uint8"),
        ("depth", np.zeros((9, 9, 3), np.uint8), r"\(9, 9, 3\): expected float"),
    ],
)
def test_an_array_that_is_no_such_image_is_refused(
    rgb_manifest: Manifest,
    depth_manifest: Manifest,
    two_trees: Trees,
    modality: str,
    image: NDArray[Any],
    message: str,
) -> None:
    manifest = {"rgb": rgb_manifest, "depth": depth_manifest}[modality]
    detector = TreeDetector(FakeSession.with_trees(manifest, **two_trees))
    with pytest.raises(InputError, match=message):
        detector.detect(image)


def test_a_model_file_detects(rgb_manifest: Manifest, write_model: Callable[..., Path]) -> None:
    detector = TreeDetector.load(write_model(rgb_manifest), threads=1)
    assert detector.manifest == rgb_manifest
    assert len(detector.detect(_image())) == 1


def test_a_model_without_our_manifest_is_refused(
    rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    path = write_model(rgb_manifest, "plain.onnx", with_manifest=False)
    with pytest.raises(ModelFileError, match=r"plain\.onnx: an ONNX model without a manifest"):
        TreeDetector.load(path)


def test_a_manifest_of_another_graph_is_refused(rgb_manifest: Manifest, two_trees: Trees) -> None:
    class Other(FakeSession):
        @property
        def input_shapes(self) -> dict[str, tuple[int | str, ...]]:
            return {"image": ("batch", 800, 800, 3)}

    with pytest.raises(ModelFileError, match=r"inputs are .*800.* expected, .*384, 640, 3"):
        TreeDetector(Other.with_trees(rgb_manifest, **two_trees))

    class Fewer(FakeSession):
        @property
        def output_names(self) -> tuple[str, ...]:
            return ("boxes", "scores", "num_detections")

    with pytest.raises(ModelFileError, match=r"outputs are .* expected, .*masks"):
        TreeDetector(Fewer.with_trees(rgb_manifest, **two_trees))


def test_settings_out_of_range_are_refused(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    with pytest.raises(InputError, match=r"score threshold is 1\.5: expected 0 to 1"):
        TreeDetector(session, score_threshold=1.5)
    with pytest.raises(InputError, match="modality is 'lidar': expected 'rgb' or 'depth'"):
        default_model("lidar")


def test_the_input_is_described_once(rgb_manifest: Manifest) -> None:
    assert standard_input("rgb", 384, 640).image_shape == (384, 640, 3)
    assert standard_input("depth", 384, 640).image_shape == (384, 640)
