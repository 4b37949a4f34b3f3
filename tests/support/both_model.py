"""A model of colour and depth that finds the same trees in every frame, and its manifest."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from edgetree.catalogue import KnownModel, default_model
from edgetree.model_file.inputs_outputs import standard_inputs
from edgetree.model_file.manifest import METADATA_KEY, Manifest, UsualRange
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.runtime.session import FakeSession

USUAL = {"lightness": (70.0, 150.0), "median_m": (2.0, 12.0), "reading_percent": (40.0, 99.0)}


def manifest_of_both(depth: Manifest) -> Manifest:
    """The manifest of a model of both, otherwise like that of a depth model."""
    size = depth.input.height, depth.input.width
    inputs = standard_inputs(*size, pad_values=(114, 255), no_depth=255)
    return dataclasses.replace(
        depth,
        name="test-both",
        modality="both",
        input=inputs[1],
        inputs=inputs,
        thresholds=dataclasses.replace(depth.thresholds, score_input=None),
        training_pictures=tuple(UsualRange(name, *limits) for name, limits in USUAL.items()),
    )


def model_bytes(manifest: Manifest, trees: dict[str, Any], batch: int | str = "batch") -> bytes:
    """The content of a model file that finds the same trees in every image."""
    images = np.zeros((batch if isinstance(batch, int) else 1, 1))
    found = FakeSession.with_trees(manifest, **trees).run({manifest.input.name: images})
    inputs = manifest.graph_inputs.values()
    return onnx_bytes(
        [Node("Identity", (f"{key}_constant",), (key,)) for key in found],
        inputs={each.name: TensorType("uint8", (batch, *each.image_shape)) for each in inputs},
        outputs={key: TensorType(value.dtype.name, value.shape) for key, value in found.items()},
        constants={f"{key}_constant": value for key, value in found.items()},
        metadata={METADATA_KEY: manifest.to_json()},
    )


def write_both_model(path: Path) -> None:
    """Write a model of both that finds two trees, with keypoints and masks."""
    depth = KnownModel("depth", default_model("depth")).manifest()
    boxes = np.array([[60, 40, 110, 300], [300, 80, 340, 330]], np.float32)
    points = np.zeros((2, 5, 3), np.float32)
    points[..., 0] = boxes[:, :1] + 20
    points[..., 1] = boxes[:, 1:2] + np.arange(10, 60, 10)
    points[..., 2] = 0.5
    trees = {"boxes": boxes, "scores": np.array([0.9, 0.6], np.float32), "keypoints": points}
    path.write_bytes(model_bytes(manifest_of_both(depth), trees, 1))
