"""A model of colour and depth takes both, or the one that shows something, and says which."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import DepthEncoding, Letterbox, encode_depth
from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import Manifest
from edgetree.runtime import ColourAndDepth, FakeSession, TreeDetector

SIZE = (48, 80)
BLACK = "the picture is black, but for 0 %"


def colour(level: int = 120) -> NDArray[np.uint8]:
    image = np.full((*SIZE, 3), level, np.uint8)
    image[::2] //= 2
    return image


def depth(metres: float = 6.0) -> NDArray[np.float32]:
    return np.linspace(metres, 1.3 * metres, SIZE[0] * SIZE[1], dtype=np.float32).reshape(SIZE)


@pytest.fixture
def detector(both_manifest: Manifest, two_trees: dict[str, Any]) -> TreeDetector:
    return TreeDetector(FakeSession.with_trees(both_manifest, **two_trees))


def given(detector: TreeDetector) -> dict[str, NDArray[Any]]:
    """What the network was given."""
    session = detector.session
    assert isinstance(session, FakeSession)
    return {name: np.asarray(values[0]) for name, values in session.inputs.items()}


def test_both_are_given_by_name(detector: TreeDetector) -> None:
    trees = detector.detect(colour(), depth_m=depth())
    assert trees.alone is None
    assert trees.unlike is None
    assert (trees.image_width, trees.image_height) == (80, 48)
    box = Letterbox.fit(80, 48, 640, 384)
    encoded = encode_depth(depth(), DepthEncoding())
    inputs = given(detector)
    np.testing.assert_array_equal(inputs["colour"], box.apply(colour(), 114))
    np.testing.assert_array_equal(inputs["depth"], box.apply(encoded, 255))


def test_borders_are_those_of_each_input(detector: TreeDetector) -> None:
    detector.detect(colour()[:, :40], depth_m=depth()[:, :40])
    inputs = given(detector)
    assert (inputs["colour"][:, -1] == 114).all()
    assert (inputs["depth"][:, -1] == 255).all()


@pytest.mark.parametrize(
    ("image", "depth_m", "used", "reason"),
    [
        (None, depth(), "depth", "there is no colour image"),
        (colour(), None, "colour", "there is no depth"),
        (colour(3), depth(), "depth", BLACK),
        (colour(), np.zeros(SIZE, np.float32), "colour", "0 % of the depth image has a reading"),
        (colour(), np.full(SIZE, np.nan), "colour", "0 % of the depth image has a reading"),
        (colour(254), depth(30.0), "colour", "0 % of the depth image has a reading in range"),
        (colour(24), depth(), "depth", "unlike the training pictures: mean lightness is"),
        (colour(), depth(0.1), "colour", "unlike the training pictures: median depth is"),
        (colour(3), None, "neither", f"{BLACK}; there is no depth"),
    ],
)
def test_one_is_used_alone_where_the_other_shows_nothing(
    detector: TreeDetector, image: Any, depth_m: Any, used: str, reason: str
) -> None:
    trees = detector.detect(image, depth_m=depth_m)
    assert trees.alone is not None
    assert trees.alone.image == used
    assert trees.alone.reason.startswith(reason)
    inputs = given(detector)
    assert inputs["colour"].any() == (used == "colour")
    assert (inputs["depth"] != 255).any() == (used == "depth")
    assert str(trees.alone).startswith("neither image" if used == "neither" else f"found by {used}")


def test_both_are_used_where_both_are_unlike_the_training(detector: TreeDetector) -> None:
    trees = detector.detect(colour(24), depth_m=depth(0.1))
    assert trees.alone is None
    assert trees.unlike is not None
    assert trees.unlike.statistic == "lightness"
    assert "fine-tuning" in trees.unlike.advice


@pytest.mark.parametrize(
    ("image", "depth_m", "reason"),
    [
        (None, None, "image and depth_m are None: expected at least one of them"),
        (depth(), None, r"image is float32 \(48, 80\): expected uint8 \(H, W, 3\) BGR"),
        (colour(), colour(), r"depth_m is uint8 \(48, 80, 3\): expected float"),
        (colour(), -depth(), "depth_m has negative depths"),
        (colour(), depth() * 1000, "millimetres"),
        (colour()[:20], depth(), "image is 80x20 px and depth_m 80x48 px: expected one size"),
    ],
)
def test_other_images_are_one_line(
    detector: TreeDetector, image: Any, depth_m: Any, reason: str
) -> None:
    with pytest.raises(InputError, match=reason):
        detector.detect(image, depth_m=depth_m)


def test_each_frame_of_a_batch_is_looked_at_by_itself(detector: TreeDetector) -> None:
    pairs = [ColourAndDepth(colour(), depth()), ColourAndDepth(None, depth()), colour()]
    alone = [trees.alone for trees in detector.detect_batch(pairs)]
    assert [each and each.image for each in alone] == [None, "depth", "colour"]


@pytest.mark.parametrize("modality", ["rgb", "depth"])
def test_models_of_one_input_take_theirs_of_the_two(
    modality: str, request: pytest.FixtureRequest, two_trees: dict[str, Any]
) -> None:
    manifest: Manifest = request.getfixturevalue(f"{modality}_manifest")
    detector = TreeDetector(FakeSession.with_trees(manifest, **two_trees))
    trees = detector.detect(colour(), depth_m=depth())
    own = given(detector)["image"]
    detector.detect(colour() if modality == "rgb" else depth())
    np.testing.assert_array_equal(own, given(detector)["image"])
    assert trees.alone is None
    with pytest.raises(InputError, match="is a NoneType: expected a plain numpy array"):
        detector.detect(**({"depth_m": depth()} if modality == "rgb" else {"image": None}))


def test_the_warm_up_runs(detector: TreeDetector) -> None:
    detector.warm_up()
    assert set(given(detector)) == {"colour", "depth"}


def test_prepared_images_have_the_depth_last(detector: TreeDetector) -> None:
    pixels = detector.prepare(ColourAndDepth(colour(), depth()))
    detector.detect(colour(), depth_m=depth())
    np.testing.assert_array_equal(pixels[..., :3], given(detector)["colour"])
    np.testing.assert_array_equal(pixels[..., 3], given(detector)["depth"])


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"inputs": ()}, r"inputs is \(\): expected \('colour', 'depth'\) for both"),
        ({"modality": "depth"}, r"inputs is \('colour', 'depth'\): expected \(\) for depth"),
        ({"depth_encoding": None}, "depth_encoding is None: expected a depth encoding"),
    ],
)
def test_a_manifest_that_contradicts_itself_is_refused(
    both_manifest: Manifest, changes: dict[str, Any], reason: str
) -> None:
    with pytest.raises(ModelFileError, match=reason):
        dataclasses.replace(both_manifest, **changes)


def test_inputs_that_contradict_each_other_are_refused(both_manifest: Manifest) -> None:
    first, depth_input = both_manifest.inputs
    for change, reason in (
        ({"nothing": None}, "input colour nothing is None"),
        ({"height": 400}, "input colour is"),
        ({"layout": "BHW"}, "input colour is"),
    ):
        inputs = (dataclasses.replace(first, **change), depth_input)
        with pytest.raises(ModelFileError, match=reason):
            dataclasses.replace(both_manifest, inputs=inputs)
    with pytest.raises(ModelFileError, match="input nothing is 256"):
        dataclasses.replace(first, nothing=256)
    assert Manifest.from_json(both_manifest.to_json()) == both_manifest


def test_a_graph_without_one_of_the_inputs_is_refused(both_manifest: Manifest) -> None:
    class Other(FakeSession):
        @property
        def input_shapes(self) -> Any:
            return {"depth": (1, 384, 640)}

    with pytest.raises(ModelFileError, match="expected 'colour' of shape"):
        TreeDetector(Other(both_manifest, {}))
