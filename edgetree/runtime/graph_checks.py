"""Checks that a graph and its outputs match the manifest."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

import calib
from basetree.arrays import Float32
from basetree.errors import InputError
from edgetree.errors import ModelFileError
from edgetree.model_file.graph_rules import MAX_ELEMENTS
from edgetree.model_file.inputs_outputs import standard_outputs
from edgetree.model_file.manifest import METADATA_KEY, Manifest, optional_inputs
from edgetree.model_file.safety_check import Shape
from edgetree.runtime.session import InferenceSession

_ROUNDING: Final = 1e-3  # tolerance of scores outside [0, 1], for providers of low precision


@dataclass(frozen=True, eq=False)
class ImageOutputs:
    """The model's outputs for one image, in pixels of the model's input.

    Attributes:
        boxes: (N, 4) x0, y0, x1, y1.
        scores: (N,) in [0, 1].
        keypoints: (N, 5, 3) x, y, score; None if the model has no keypoint output.
        keypoint_stds: (N, 5, 2) standard deviations in x, y; None if the model does not give them.
        masks: (N, 28, 28) probabilities on a grid over the box; None if the model has no masks.
    """

    boxes: Float32
    scores: Float32
    keypoints: Float32 | None
    keypoint_stds: Float32 | None
    masks: Float32 | None


def read_manifest(session: InferenceSession) -> Manifest:
    """Read the manifest of a model and check that it matches the graph.

    Raises:
        ModelFileError: The manifest is missing or invalid, or contradicts the graph.
    """
    try:
        return _read_manifest(session)
    except InputError as error:
        raise ModelFileError(f"model {session.name}: {error}") from error


def _read_manifest(session: InferenceSession) -> Manifest:
    text = session.metadata.get(METADATA_KEY)
    if text is None:
        raise ModelFileError(
            f"no manifest (metadata {METADATA_KEY!r}): expected a file made by `edgetree export`"
        )
    manifest = Manifest.from_json(text)
    if manifest.depth_encoding is not None:
        calib.DepthEncoding.from_dict(dict(manifest.depth_encoding))
    shapes, inputs = dict(session.input_shapes), manifest.graph_inputs.values()
    wanted = {target.name: target.image_shape for target in inputs}
    optional = optional_inputs(manifest)
    images = {name: shape[1:] for name, shape in shapes.items() if name not in optional}
    if images != wanted or any(shapes.get(name) != shape for name, shape in optional.items()):
        expected = [
            *(f"{name!r} of shape (batch, {', '.join(map(str, wanted[name]))})" for name in wanted),
            *(f"{name!r} of shape {shape}" for name, shape in optional.items()),
        ]
        raise ModelFileError(
            f"the graph's inputs are {shapes}: expected {' and '.join(expected)}, as in its"
            " manifest"
        )
    for target in inputs:
        _check_size(target.name, shapes[target.name])
    if set(session.output_shapes) != set(manifest.output_names):
        raise ModelFileError(
            f"the graph's outputs are {tuple(session.output_shapes)}: expected"
            f" {manifest.output_names}, as in its manifest"
        )
    _check_output_shapes(manifest, session.output_shapes)
    return manifest


def _check_output_shapes(manifest: Manifest, shapes: Mapping[str, Shape]) -> None:
    """Check the outputs in the manifest against `standard_outputs` and the graph's `shapes`."""
    stated = {output.name: output.shape for output in manifest.outputs}
    rows = stated["scores"][1:]
    if len(rows) != 1 or not isinstance(rows[0], int) or rows[0] < 1:
        raise ModelFileError(f"manifest: output scores is {stated['scores']}: expected (B, rows)")
    for output in standard_outputs(rows[0]):
        shape = stated.get(output.name)
        if shape is None:
            continue
        if shape != output.shape:
            raise ModelFileError(
                f"manifest: output {output.name} is {shape}: expected {output.shape}"
            )
        _check_size(output.name, shape)
        found = shapes[output.name]
        pairs = zip(found[1:], shape[1:], strict=False)
        if len(found) != len(shape) or any(a != b for a, b in pairs if isinstance(a, int)):
            raise ModelFileError(
                f"the graph's output {output.name} is {found}: expected {shape}, as in its manifest"
            )


def _check_size(name: str, shape: Shape) -> None:
    known = [size for size in shape if isinstance(size, int)]
    if math.prod(known) > MAX_ELEMENTS:
        raise ModelFileError(f"{name} is {shape}: expected at most {MAX_ELEMENTS} elements")


def check_outputs(
    outputs: Mapping[str, NDArray[Any]], manifest: Manifest, batch: int, name: str
) -> list[ImageOutputs]:
    """Check that the outputs of one inference match the manifest, and split them by image.

    Args:
        outputs: The graph's outputs by name.
        manifest: The model's manifest.
        batch: Number of images in the batch.
        name: Name of the model in error messages.

    Returns:
        The outputs of each image, without unused rows and with scores clipped to [0, 1].

    Raises:
        ModelFileError: An output is missing or has another shape or dtype, `num_detections` is out
            of range, a value is not finite, or a score is not in [0, 1].
    """
    for output in manifest.outputs:
        shape = (batch, *output.shape[1:])
        values = outputs.get(output.name)
        found = "missing" if values is None else f"{values.dtype} {values.shape}"
        if values is None or values.shape != shape or values.dtype != output.dtype:
            raise ModelFileError(
                f"model {name} gave {output.name} as {found}:"
                f" expected {output.dtype} {shape}, as in its manifest"
            )
    return [_outputs_of_image(outputs, index, name) for index in range(batch)]


def _outputs_of_image(outputs: Mapping[str, NDArray[Any]], index: int, name: str) -> ImageOutputs:
    """The used rows of one image, checked."""
    count = int(outputs["num_detections"][index])
    rows = outputs["scores"].shape[1]
    if not 0 <= count <= rows:
        raise ModelFileError(f"model {name} gave {count} detections: expected 0 to {rows}")
    used = {
        output: values[index, :count]
        for output, values in outputs.items()
        if output in ("boxes", "scores", "keypoints", "keypoint_stds", "masks")
    }
    for output, values in used.items():
        if not np.isfinite(values).all():
            raise ModelFileError(
                f"model {name} gave {output} with NaN or infinity: expected finite numbers"
            )
    scores = used["scores"]
    if count and not (scores.min() >= -_ROUNDING and scores.max() <= 1 + _ROUNDING):
        raise ModelFileError(
            f"model {name} gave scores of {scores.min():g} to {scores.max():g}: expected 0 to 1"
        )
    branches = (used.get(output) for output in ("keypoints", "keypoint_stds", "masks"))
    return ImageOutputs(used["boxes"], np.clip(scores, 0, 1), *branches)
