"""The manifest survives a round trip through JSON; errors name the wrong field."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import pytest

from edgetree.errors import ModelFileError
from edgetree.model_file.manifest import Manifest, standard_outputs


def test_a_manifest_survives_json(rgb_manifest: Manifest, depth_manifest: Manifest) -> None:
    for manifest in (rgb_manifest, depth_manifest):
        assert Manifest.from_json(manifest.to_json()) == manifest


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
        (["modality"], "lidar", "modality is 'lidar': expected 'rgb' or 'depth'"),
        (["input", "height"], "384", "input: height is '384': expected a whole number"),
        (["input", "width"], True, "input: width is True: expected a whole number"),
        (["input", "height"], 8, "input size is '640x8': expected 32x32 or more"),
        (["input", "colour_order"], "RGB", "colour_order is 'RGB': expected 'BGR'"),
        (["input", "batch_sizes"], [0], "batch_sizes is .* expected at least one number"),
        (["resize", "rule"], "stretch", "resize rule is 'stretch': expected 'letterbox-top-left'"),
        (["mean"], [0.5], "mean is .* expected 3 number"),
        (["mean"], "none", "mean is 'none': expected a list"),
        (["depth_encoding"], {"near_m": 0.0}, "depth_encoding is .* null for an rgb model"),
        (["keypoint_names"], ["top"], "keypoint_names is .*'top'.* expected .*felling_cut"),
        (["thresholds", "score"], 2, "threshold score is 2.0: expected 0 to 1"),
        (["outputs"], [], r"keypoint_names is .* expected \(\)"),
        (["keypoint_flip_pairs"], [[1, 2, 3]], "keypoint_flip_pairs.* has 3 items: expected 2"),
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
        "masks": ("B", 20, 28, 28),
        "num_detections": ("B",),
    }
