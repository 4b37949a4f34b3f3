"""The manifest survives a round trip through JSON; errors name the wrong field."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from basetree.errors import EdgetreeError
from edgetree.detections import KEYPOINT_NAMES
from edgetree.errors import ModelFileError
from edgetree.model_file.inputs_outputs import standard_input, standard_outputs
from edgetree.model_file.manifest import (
    ClassifierCost,
    Manifest,
    ResizeRule,
    Thresholds,
    UsualRange,
)

COUNTS = st.integers(0, 2**53)
MAYBE_COUNTS = st.none() | COUNTS
SHARES = st.floats(0, 1)
FINITE = st.floats(allow_nan=False, allow_infinity=False)
RANGES = st.tuples(st.text(), FINITE, FINITE).map(lambda r: UsualRange(r[0], *sorted(r[1:])))
FACTS = st.dictionaries(st.text(), st.none() | COUNTS | FINITE | st.text() | st.lists(FINITE))


@st.composite
def manifests(draw: st.DrawFn) -> Manifest:
    """Manifests of both modalities with any values that fit each other."""
    modality = draw(st.sampled_from(["rgb", "depth"]))
    keypoints = draw(st.booleans())
    channels = 3 if modality == "rgb" else draw(st.sampled_from([1, 3]))
    numbers = st.lists(FINITE, min_size=channels, max_size=channels).map(tuple)
    side = st.integers(32, 4096)
    sizes = st.lists(st.integers(1, 64), min_size=1, max_size=3).map(tuple)
    pairs = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), max_size=3).map(tuple)
    graph_input = standard_input(modality, draw(side), draw(side))
    masks = draw(st.booleans())
    return Manifest(
        name=draw(st.text()),
        backbone=draw(st.text()),
        modality=modality,
        input=dataclasses.replace(graph_input, batch_sizes=draw(sizes)),
        resize=ResizeRule(pad_value=draw(st.integers(0, 255))),
        mean=draw(numbers),
        std=draw(numbers),
        depth_encoding=draw(FACTS) if modality == "depth" else None,
        outputs=standard_outputs(draw(st.integers(1, 300)), keypoints=keypoints, masks=masks),
        classes=draw(st.lists(st.text(), max_size=3).map(tuple)),
        keypoint_names=KEYPOINT_NAMES if keypoints else (),
        keypoint_flip_pairs=draw(pairs),
        thresholds=Thresholds(draw(SHARES), draw(SHARES), draw(SHARES)),
        precision=draw(st.text()),
        opset=draw(COUNTS),
        parameters=draw(COUNTS),
        weights_sha256=draw(st.text()),
        training_data=draw(st.text()),
        project_version=draw(st.text()),
        parity=draw(st.none() | FACTS),
        calibration_sha256=draw(st.none() | st.text()),
        proposals=draw(MAYBE_COUNTS),
        multiply_adds=draw(MAYBE_COUNTS),
        classifier=draw(st.none() | st.builds(ClassifierCost, COUNTS, COUNTS)),
        target=draw(st.text()),
        weight_bits=draw(MAYBE_COUNTS),
        training_pictures=draw(st.lists(RANGES, max_size=3).map(tuple)),
        error_factor=draw(st.floats(0.1, 10)),
    )


@given(manifests())
def test_a_manifest_survives_json(manifest: Manifest) -> None:
    assert Manifest.from_json(manifest.to_json()) == manifest


def _places(value: Any, here: tuple[str | int, ...] = ()) -> list[tuple[str | int, ...]]:
    """Paths of everything inside a JSON value."""
    inside: list[tuple[Any, Any]] = []
    if isinstance(value, dict):
        inside = list(value.items())
    elif isinstance(value, list):
        inside = list(enumerate(value))
    deeper = [place for key, part in inside for place in _places(part, (*here, key))]
    return [(*here, key) for key, _ in inside] + deeper


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=6,
)


@settings(max_examples=300)
@given(data=st.data())
def test_a_manifest_with_a_damaged_field_is_read_or_refused(
    rgb_manifest: Manifest, depth_manifest: Manifest, data: st.DataObject
) -> None:
    costs = {"classifier": ClassifierCost(100, 40), "proposals": 300}
    costs |= {"training_pictures": (UsualRange("contrast", 20, 70),)}
    complete = [dataclasses.replace(known, **costs) for known in (rgb_manifest, depth_manifest)]
    values = json.loads(data.draw(st.sampled_from(complete), "manifest").to_json())
    *path, last = data.draw(st.sampled_from(_places(values)), "place")
    target = values
    for key in path:
        target = target[key]
    if data.draw(st.booleans(), "removed"):
        del target[last]
    else:
        target[last] = data.draw(JSON_VALUES, "value")
    message = ""
    try:
        Manifest.from_json(json.dumps(values)).to_json()
    except EdgetreeError as error:
        message = str(error)
    assert message.startswith("manifest" if message else "")
    assert "\n" not in message


@pytest.mark.parametrize(
    "name",
    [
        field.name
        for field in dataclasses.fields(Manifest)
        if field.default is field.default_factory is dataclasses.MISSING
    ],
)
@pytest.mark.parametrize("how", ["missing", "of another kind"])
def test_every_required_field_is_refused_when_damaged(
    rgb_manifest: Manifest, name: str, how: str
) -> None:
    values = json.loads(rgb_manifest.to_json())
    if how == "missing":
        del values[name]
    else:
        values[name] = True
    with pytest.raises(EdgetreeError, match=rf"manifest.*{name}"):
        Manifest.from_json(json.dumps(values))


@given(st.text() | JSON_VALUES.map(json.dumps))
@example("[" * 100_000)
@example('{"schema": ' * 100_000)
@example("1" * 5000)
def test_any_text_is_read_or_refused(text: str) -> None:
    with pytest.raises(EdgetreeError, match=r"^manifest"):
        Manifest.from_json(text)


def test_json_integers_are_valid_floats(rgb_manifest: Manifest) -> None:
    data = json.loads(rgb_manifest.to_json())
    data["mean"] = [103, 116, 124]
    assert Manifest.from_json(json.dumps(data)).mean == (103.0, 116.0, 124.0)


def test_unknown_fields_are_ignored(rgb_manifest: Manifest) -> None:
    data = json.loads(rgb_manifest.to_json())
    data["added_later"] = {"x": 1}
    data["input"]["added_later"] = 1
    assert Manifest.from_json(json.dumps(data)) == rgb_manifest


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (["schema"], "edgetree.manifest/9", r"schema is 'edgetree.manifest/9': expected"),
        (["modality"], "lidar", "modality is 'lidar': expected 'rgb', 'depth' or 'both'"),
        (["input", "height"], "384", "input.height is '384', expected a whole number"),
        (["input", "width"], True, "input.width is true, expected a whole number"),
        (["input", "height"], 8, "input size is '640x8': expected 32x32 or more"),
        (["input", "colour_order"], "RGB", "colour_order is 'RGB': expected 'BGR'"),
        (["input", "batch_sizes"], [0], "batch_sizes is .* expected at least one number"),
        (["resize", "rule"], "stretch", "resize rule is 'stretch': expected 'letterbox-top-left'"),
        (["mean"], [0.5], "mean is .* expected 3 number"),
        (["mean"], [10**400, 0, 0], r"not JSON \(1000.* is not a number of 64 bits"),
        (["depth_encoding"], {"far_m": 10**400}, r"not JSON \(1000.* is not a number of 64 bits"),
        (["std"], [1, math.nan, 1], r"manifest: not JSON \(NaN is not a JSON number\)"),
        (["mean"], "none", "mean is 'none', expected a list"),
        (["depth_encoding"], {"near_m": 0.0}, "depth_encoding is .* null for an rgb model"),
        (["keypoint_names"], ["top"], "keypoint_names is .*'top'.* expected .*felling_cut"),
        (["thresholds", "score"], 2, "threshold score is 2.0: expected 0 to 1"),
        (["outputs"], [], r"keypoint_names is .* expected \(\)"),
        (["error_factor"], 0, "error_factor is 0.0: expected 0.1 to 10"),
        (
            ["training_pictures"],
            [{"statistic": "lightness", "low": 9, "high": 3}],
            r"range of lightness is \(9.0, 3.0\): expected low <= high",
        ),
        (
            ["training_pictures"],
            {"lightness": [3, 9]},
            "training_pictures is an object, expected a list",
        ),
        (["keypoint_flip_pairs"], [[1, 2, 3]], "is a list of 3 items, expected a list of 2 items"),
    ],
)
def test_a_wrong_value_is_named(
    rgb_manifest: Manifest, path: list[str], value: Any, message: str
) -> None:
    data = json.loads(rgb_manifest.to_json())
    target = data
    for key in path[:-1]:
        target = target[key]
    target[path[-1]] = value
    with pytest.raises(ModelFileError, match=message):
        Manifest.from_json(json.dumps(data))


@pytest.mark.parametrize("text", ["", "{", "[1]", "3", '"x"'])
def test_text_that_is_not_a_manifest_is_rejected(text: str) -> None:
    with pytest.raises(ModelFileError, match=r"manifest: (not JSON|schema is None)"):
        Manifest.from_json(text)


def test_a_missing_field_is_named(rgb_manifest: Manifest) -> None:
    data = json.loads(rgb_manifest.to_json())
    del data["input"]["dtype"]
    with pytest.raises(ModelFileError, match="input has no field 'dtype'"):
        Manifest.from_json(json.dumps(data))


def test_a_model_without_keypoints_has_no_keypoint_names(rgb_manifest: Manifest) -> None:
    outputs = standard_outputs(20, keypoints=False, masks=False)
    manifest = dataclasses.replace(rgb_manifest, outputs=outputs, keypoint_names=())
    assert manifest.output_names == ("boxes", "scores", "num_detections")
    assert not Manifest.from_json(manifest.to_json()).has_output("keypoints")


def test_the_standard_outputs_have_the_documented_shapes() -> None:
    shapes = {output.name: output.shape for output in standard_outputs(20)}
    assert shapes == {
        "boxes": ("B", 20, 4),
        "scores": ("B", 20),
        "keypoints": ("B", 20, 5, 3),
        "keypoint_stds": ("B", 20, 5, 2),
        "masks": ("B", 20, 28, 28),
        "num_detections": ("B",),
    }
