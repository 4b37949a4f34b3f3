"""The detector's input to the model, and its mapping of outputs back to the image."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError
from edgetree.errors import ModelFileError
from edgetree.model_file.inputs_outputs import standard_input, standard_outputs
from edgetree.model_file.manifest import SCORE_INPUT, Manifest, Thresholds
from edgetree.runtime import TreeDetector, default_model
from edgetree.runtime.session import FakeSession

Trees = dict[str, NDArray[np.float32]]


def _image(width: int = 1280, height: int = 720) -> NDArray[np.uint8]:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), np.uint8)


@pytest.mark.parametrize(("width", "height", "factor"), [(1280, 720, 2), (640, 384, 1)])
def test_outputs_are_mapped_to_the_image(
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


def test_deviations_of_keypoints_are_mapped_to_the_image(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    stds = np.random.default_rng(0).uniform(1, 9, (2, 5, 2)).astype(np.float32)
    session = FakeSession.with_trees(rgb_manifest, **two_trees, keypoint_stds=stds)
    trees = TreeDetector(session, score_threshold=0.01).detect(_image(1280, 720))
    assert trees.keypoint_stds_px is not None
    np.testing.assert_allclose(trees.keypoint_stds_px, stds * 2, rtol=1e-5)


def test_files_of_before_say_nothing_about_keypoints(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    kept = tuple(each for each in rgb_manifest.outputs if each.name != "keypoint_stds")
    manifest = dataclasses.replace(rgb_manifest, outputs=kept)
    trees = TreeDetector(FakeSession.with_trees(manifest, **two_trees)).detect(_image())
    assert trees.keypoints_px is not None
    assert trees.keypoint_stds_px is None


def test_outputs_are_mapped_to_a_tall_image(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    trees = TreeDetector(session).detect(_image(600, 960))
    np.testing.assert_allclose(trees.boxes_px[0], two_trees["boxes"][0] * 2.5, atol=1e-3)


def test_trees_in_the_padding_are_left_out(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    # A tall image fills only the left 240 pixels of the input; the second tree starts at 400.
    trees = TreeDetector(session, score_threshold=0.01).detect(_image(600, 960))
    assert len(trees) == 1


def test_keypoints_and_masks_of_left_out_trees_are_left_out(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    two_trees["boxes"] = two_trees["boxes"][::-1].copy()
    two_trees["keypoints"][1] += 5
    masks = np.stack([np.zeros((28, 28)), np.ones((28, 28))]).astype(np.float32)
    session = FakeSession.with_trees(rgb_manifest, **two_trees, masks=masks)
    trees = TreeDetector(session, score_threshold=0.01).detect(_image(600, 960))
    assert trees.keypoints_px is not None
    assert trees.masks is not None
    expected = two_trees["keypoints"][1:, :, :2] * 2.5
    np.testing.assert_allclose(trees.keypoints_px[..., :2], expected, atol=1e-3)
    np.testing.assert_array_equal(trees.masks, masks[1:])


def test_trees_have_the_errors_that_the_file_says(rgb_manifest: Manifest, two_trees: Trees) -> None:
    rough = dataclasses.replace(rgb_manifest, error_factor=1.5)
    trees = TreeDetector(FakeSession.with_trees(rough, **two_trees)).detect(_image())
    assert len(trees) > 0
    assert trees.error_factor == 1.5


def test_the_model_gets_the_images_bytes(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    image = _image(640, 360)
    TreeDetector(session).detect(image)
    seen = session.inputs["image"]
    assert seen.dtype == np.uint8
    assert seen.shape == (1, 384, 640, 3)
    np.testing.assert_array_equal(seen[0, :360], image)
    assert (seen[0, 360:] == 114).all()


def test_the_threshold_and_the_count_select_the_rows(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    assert len(TreeDetector(session).detect(_image())) == 1
    assert len(TreeDetector(session, score_threshold=0.3).detect(_image())) == 2
    none = {name: rows[:0] for name, rows in two_trees.items()}
    empty = FakeSession.with_trees(rgb_manifest, **none)
    assert len(TreeDetector(empty, score_threshold=0.0).detect(_image())) == 0


@pytest.mark.parametrize(("threshold", "given"), [(0.5, 0.5), (0.0, 0.01)])
def test_a_graph_that_takes_the_lowest_score_gets_the_detectors(
    rgb_manifest: Manifest, two_trees: Trees, threshold: float, given: float
) -> None:
    session = FakeSession.with_trees(_taking_scores(rgb_manifest), **two_trees)
    detector = TreeDetector(session, score_threshold=threshold)
    detector.detect(_image())
    lowest = session.inputs["score_threshold"]
    assert (lowest.dtype, lowest.tolist()) == (np.float32, [np.float32(given)])
    detector.score_threshold = 0.7
    detector.detect_batch([_image(), _image()])
    assert session.inputs["score_threshold"].tolist() == [np.float32(0.7)]
    plain = FakeSession.with_trees(rgb_manifest, **two_trees)
    TreeDetector(plain).detect(_image())
    assert list(plain.inputs) == ["image"]


def test_a_graph_without_the_input_that_its_manifest_names_is_rejected(
    rgb_manifest: Manifest, two_trees: Trees, write_model: Callable[..., Path]
) -> None:
    path = write_model(_taking_scores(rgb_manifest))
    with pytest.raises(ModelFileError, match=r"inputs are .* expected .*'score_threshold'"):
        TreeDetector.load(path)
    thresholds = {"score": 0.01, "nms_iou": 0.5, "score_input": "image"}
    with pytest.raises(ModelFileError, match=r"score_input is 'image': expected 'score_threshold'"):
        Thresholds(**thresholds)


def _taking_scores(manifest: Manifest) -> Manifest:
    thresholds = dataclasses.replace(manifest.thresholds, score_input=SCORE_INPUT)
    return dataclasses.replace(manifest, thresholds=thresholds)


def test_a_model_without_keypoints_and_masks_works(
    rgb_manifest: Manifest, two_trees: Trees
) -> None:
    outputs = standard_outputs(20, keypoints=False, masks=False)
    manifest = dataclasses.replace(rgb_manifest, outputs=outputs, keypoint_names=())
    session = FakeSession.with_trees(manifest, two_trees["boxes"], two_trees["scores"])
    trees = TreeDetector(session).detect(_image())
    assert trees.keypoints_px is None
    assert trees.masks is None


def test_a_model_file_detects(rgb_manifest: Manifest, write_model: Callable[..., Path]) -> None:
    detector = TreeDetector.load(write_model(rgb_manifest), threads=1)
    assert detector.manifest == rgb_manifest
    assert len(detector.detect(_image())) == 1


def test_a_model_without_a_manifest_is_rejected(
    rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    path = write_model(rgb_manifest, "plain.onnx", with_manifest=False)
    with pytest.raises(ModelFileError, match=r"plain\.onnx: no manifest"):
        TreeDetector.load(path)


def test_a_manifest_of_another_graph_is_rejected(rgb_manifest: Manifest, two_trees: Trees) -> None:
    class Other(FakeSession):
        @property
        def input_shapes(self) -> dict[str, tuple[int | str, ...]]:
            return {"image": ("batch", 800, 800, 3)}

    with pytest.raises(ModelFileError, match=r"inputs are .*800.* expected .*384, 640, 3"):
        TreeDetector(Other.with_trees(rgb_manifest, **two_trees))

    class Fewer(FakeSession):
        @property
        def output_shapes(self) -> dict[str, tuple[int | str, ...]]:
            return {"boxes": (1, 20, 4), "scores": (1, 20), "num_detections": (1,)}

    with pytest.raises(ModelFileError, match=r"outputs are .* expected .*masks"):
        TreeDetector(Fewer.with_trees(rgb_manifest, **two_trees))


def _with_output(manifest: Manifest, name: str, shape: tuple[int | str, ...]) -> Manifest:
    outputs = tuple(
        dataclasses.replace(output, shape=shape) if output.name == name else output
        for output in manifest.outputs
    )
    return dataclasses.replace(manifest, outputs=outputs)


@pytest.mark.parametrize(
    ("name", "shape", "message"),
    [
        ("boxes", ("B", 20, 5), r"output boxes is \('B', 20, 5\): expected \('B', 20, 4\)"),
        ("masks", ("B", 7, 28, 28), r"output masks is .*: expected \('B', 20, 28, 28\)"),
        ("scores", ("B", "rows"), r"output scores is .*: expected \(B, rows\)"),
        ("scores", ("B",), r"output scores is .*: expected \(B, rows\)"),
    ],
)
def test_a_manifest_of_other_outputs_is_rejected(
    rgb_manifest: Manifest, name: str, shape: tuple[int | str, ...], message: str
) -> None:
    with pytest.raises(ModelFileError, match=f"model test-rgb: manifest: {message}"):
        TreeDetector(FakeSession(_with_output(rgb_manifest, name, shape), {}))


def test_a_graph_with_fewer_rows_than_its_manifest_is_rejected(
    rgb_manifest: Manifest, write_model: Callable[..., Path]
) -> None:
    class Fewer(FakeSession):
        @property
        def output_shapes(self) -> dict[str, tuple[int | str, ...]]:
            return {**super().output_shapes, "boxes": (1, 10, 4)}

    with pytest.raises(ModelFileError, match=r"graph's output boxes is \(1, 10, 4\): expected"):
        TreeDetector(Fewer(rgb_manifest, {}))


@pytest.mark.parametrize("what", ["rows", "input"])
def test_a_manifest_with_too_large_sizes_is_rejected(rgb_manifest: Manifest, what: str) -> None:
    if what == "rows":
        manifest = dataclasses.replace(rgb_manifest, outputs=standard_outputs(10**9))
    else:
        size = dataclasses.replace(rgb_manifest.input, height=10**6, width=10**6)
        manifest = dataclasses.replace(rgb_manifest, input=size)
    with pytest.raises(ModelFileError, match=r"1000000.*: expected at most 268435456 elements"):
        TreeDetector(FakeSession(manifest, {}))


def test_settings_out_of_range_are_refused(rgb_manifest: Manifest, two_trees: Trees) -> None:
    session = FakeSession.with_trees(rgb_manifest, **two_trees)
    with pytest.raises(InputError, match=r"score threshold is 1\.5: expected 0 to 1"):
        TreeDetector(session, score_threshold=1.5)
    with pytest.raises(
        InputError, match="no model is called 'lidar': expected a file or depth, edge"
    ):
        default_model("lidar")


def test_the_input_is_described_once(rgb_manifest: Manifest) -> None:
    assert standard_input("rgb", 384, 640).image_shape == (384, 640, 3)
    assert standard_input("depth", 384, 640).image_shape == (384, 640)
