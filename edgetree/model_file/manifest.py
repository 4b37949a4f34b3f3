"""The manifest: the description of a model inside its file.

It is one JSON object in the metadata of the ONNX file, under the key `METADATA_KEY`. The export
writes it. The runtime takes all it needs to know from it: input size, colour order, resizing,
depth encoding and the names of outputs.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from basetree.errors import InputError
from basetree.files.json import build, parse_json
from edgetree.detections import ERROR_FACTORS, KEYPOINT_NAMES
from edgetree.errors import ModelFileError
from edgetree.model_file.inputs_outputs import (
    COLOUR,
    COLOUR_ORDERS,
    DEPTH,
    LAYOUTS,
    MODALITIES,
    InputSpec,
    OutputSpec,
    require,
)

METADATA_KEY: Final = "edgetree.manifest"
SCHEMA: Final = "edgetree.manifest/1"
SCORE_INPUT: Final = "score_threshold"
"""Name of the graph's optional input, see `Thresholds.score_input`."""
RESIZE_RULE: Final = "letterbox-top-left"
_CHANNELS: Final = {"rgb": (3,), "depth": (1, 3), "both": (1, 3)}


@dataclass(frozen=True)
class ResizeRule:
    """How images are resized to the input: `calib.Letterbox`, padded with `pad_value` (0-255)."""

    rule: str = RESIZE_RULE
    pad_value: int = 0

    def __post_init__(self) -> None:
        require(self.rule == RESIZE_RULE, "resize rule", self.rule, repr(RESIZE_RULE))
        require(0 <= self.pad_value <= 255, "resize pad_value", self.pad_value, "0 to 255")


@dataclass(frozen=True)
class Thresholds:
    """Thresholds for the outputs.

    Attributes:
        score: Lowest score that the graph outputs unless `score_input` is given.
        nms_iou: IoU of boxes above which the graph keeps the one with the higher score.
        mask_overlap: After the graph, of two trees whose masks have more than this share of the
            smaller one in common, the one with the higher score is kept.
        score_input: Name of an optional input of the graph, float32 of shape (1,), the lowest score
            that is wanted. The graph gives no rows below it, and takes no time for their masks and
            keypoints. None in files without it.
    """

    score: float
    nms_iou: float
    mask_overlap: float = 0.8
    score_input: str | None = None

    def __post_init__(self) -> None:
        known = self.score_input in (None, SCORE_INPUT)
        require(known, "threshold score_input", self.score_input, f"{SCORE_INPUT!r} or null")
        for name in ("score", "nms_iou", "mask_overlap"):
            value = getattr(self, name)
            require(0.0 <= value <= 1.0, f"threshold {name}", value, "0 to 1")


@dataclass(frozen=True)
class ClassifierCost:
    """Cost of the backbone as an ImageNet classifier of one 224x224 px image."""

    parameters: int
    multiply_adds: int


@dataclass(frozen=True)
class UsualRange:
    """Where a statistic of the pictures that a model was trained on usually lies.

    Attributes:
        statistic: Name of the statistic, a key of `calib.picture_statistics`.
        low: 1st percentile over the pictures.
        high: 99th percentile.
    """

    statistic: str
    low: float
    high: float

    def __post_init__(self) -> None:
        found = (self.low, self.high)
        is_range = -math.inf < self.low <= self.high < math.inf
        require(is_range, f"range of {self.statistic}", found, "low <= high")


@dataclass(frozen=True)
class Manifest:
    """Description of a model file.

    Attributes:
        name: Name of the model.
        backbone: Name of its backbone.
        modality: "rgb", "depth" or "both", the kind of image that the model takes. What is said of
            the input is of the depth, where the model takes both.
        input: The graph's input.
        resize: How images are resized to the input.
        mean: Mean per channel, in the input's colour order; the graph subtracts it from the uint8
            values. Three values for a depth model that repeats its channel three times.
        std: Standard deviation per channel, likewise; the graph divides by it.
        depth_encoding: `calib.DepthEncoding.to_dict()` of a model that takes depth, else None.
        outputs: The graph's outputs, see `standard_outputs`.
        classes: Names of the classes.
        keypoint_names: `KEYPOINT_NAMES`, or empty for a model without keypoints.
        keypoint_flip_pairs: Pairs of keypoint indices that a horizontal flip swaps.
        thresholds: Thresholds for the outputs.
        precision: "float32", "float16" or "int8".
        opset: ONNX opset of the graph.
        parameters: Number of weights. Of a combined file that of all its models; all other values
            are those of the model of both images.
        weights_sha256: Hash of the checkpoint's weights.
        training_data: id of the data that the weights were trained on.
        project_version: Version of edgetree that wrote the file.
        parity: Results of the export's parity check.
        calibration_sha256: Hash of the calibration data of a quantised model, else None.
        proposals: Region proposals per frame for the box head; None in older files.
        multiply_adds: Multiply-adds of the whole network for one frame with as many trees as the
            file can give; None in older files.
        classifier: Cost of the backbone alone, as papers give it; None in older files.
        target: The provider that the file was exported for.
        weight_bits: Bits that the weights of an 8-bit model use. With 8, x86 processors without
            VNNI give other results. None for other precisions and in older files.
        training_pictures: How the pictures of the last training run look; empty in older files.
        error_factor: Standard deviation of keypoints and mask edges, relative to those that
            `edgetree.measure.MeasureSettings` states; 1 in older files.
        inputs: The colour input and the depth input of a model of both; empty for one input.
        alone: Of a combined file, the manifests of its models of `colour` and `depth`, which run
            where only this image shows anything; empty for others.
        reach_m: Largest distance from the camera at which trees were labelled, to the axis of the
            stem at the felling cut, m; None if there was none, or it is not known.
        schema: Version of this layout.

    Raises:
        ModelFileError: Values contradict each other.
    """

    name: str
    backbone: str
    modality: str
    input: InputSpec
    resize: ResizeRule
    mean: tuple[float, ...]
    std: tuple[float, ...]
    depth_encoding: Mapping[str, Any] | None
    outputs: tuple[OutputSpec, ...]
    classes: tuple[str, ...]
    keypoint_names: tuple[str, ...]
    keypoint_flip_pairs: tuple[tuple[int, int], ...]
    thresholds: Thresholds
    precision: str
    opset: int
    parameters: int
    weights_sha256: str
    training_data: str
    project_version: str
    parity: Mapping[str, Any] | None = None
    calibration_sha256: str | None = None
    proposals: int | None = None
    multiply_adds: int | None = None
    classifier: ClassifierCost | None = None
    target: str = "cpu"
    weight_bits: int | None = None
    training_pictures: tuple[UsualRange, ...] = ()
    error_factor: float = 1.0
    inputs: tuple[InputSpec, ...] = ()
    alone: Mapping[str, Manifest] = field(default_factory=dict)
    reach_m: float | None = None
    schema: str = SCHEMA

    def __post_init__(self) -> None:
        require(self.schema == SCHEMA, "schema", self.schema, repr(SCHEMA))
        require(self.modality in LAYOUTS, "modality", self.modality, MODALITIES)
        smallest, largest = ERROR_FACTORS
        plausible = smallest <= self.error_factor <= largest
        expected = f"{smallest:g} to {largest:g}"
        require(plausible, "error_factor", self.error_factor, expected)
        reach_m = self.reach_m
        known = reach_m is None or 0 < reach_m < math.inf
        require(known, "reach_m", reach_m, "a distance over 0, or null")
        layout, order = LAYOUTS[self.modality], COLOUR_ORDERS[self.modality]
        require(self.input.layout == layout, "input layout", self.input.layout, repr(layout))
        colour = self.input.colour_order
        require(colour == order, "input colour_order", colour, repr(order))
        for name in ("mean", "std"):
            values = getattr(self, name)
            allowed = _CHANNELS[self.modality]
            expected = f"{' or '.join(map(str, allowed))} number(s)"
            require(len(values) in allowed, name, values, expected)
        has_encoding = self.depth_encoding is not None
        expected = "a depth encoding for a model that takes depth, and null for an rgb model"
        needs_encoding = self.modality != "rgb"
        require(has_encoding == needs_encoding, "depth_encoding", self.depth_encoding, expected)
        names = self.keypoint_names
        expected_names = KEYPOINT_NAMES if self.has_output("keypoints") else ()
        require(names == expected_names, "keypoint_names", names, repr(expected_names))
        needed = {"boxes", "scores", "num_detections"}
        require(all(map(self.has_output, needed)), "outputs", self.output_names, f"{needed}")
        self._check_inputs()
        self._check_alone()

    def _check_inputs(self) -> None:
        """Check the list of inputs, which a model of both has."""
        found = tuple(each.name for each in self.inputs)
        expected = (COLOUR, DEPTH) if self.modality == "both" else ()
        require(found == expected, "inputs", found, f"{expected} for {self.modality}")
        if not self.inputs:
            return
        colour, depth = self.inputs
        require(depth == self.input, "input", self.input.name, "the depth of inputs")
        shape = (colour.layout, colour.colour_order, colour.height, colour.width)
        wanted = ("BHWC", "BGR", depth.height, depth.width)
        require(shape == wanted, "input colour", shape, repr(wanted))
        for each in self.inputs:
            require(each.nothing is not None, f"input {each.name} nothing", None, "0 to 255")

    def _check_alone(self) -> None:
        """Check that the models of a combined file are like the one of both images."""
        kinds = tuple(sorted(self.alone))
        allowed = (COLOUR, DEPTH) if self.takes_both else ()
        require(kinds in ((), allowed), "alone", kinds, f"{allowed}")
        batches = self.input.batch_sizes
        require(not kinds or batches == (1,), "batch sizes", batches, "(1,) of a combined file")
        for kind, model in self.alone.items():
            modality = "depth" if kind == DEPTH else "rgb"
            where = f"{kind} alone, {model.name}"
            require(model.modality == modality, f"{where}: modality", model.modality, modality)
            target = self.graph_inputs[kind]
            encoding = model.depth_encoding if kind == DEPTH else self.depth_encoding
            for name, value, expected in (
                ("input size", model.input.image_shape, target.image_shape),
                ("batch sizes", model.input.batch_sizes, batches),
                ("pad value", model.resize.pad_value, self.pad_value_of(target)),
                ("depth encoding", encoding, self.depth_encoding),
                ("outputs", model.outputs, self.outputs),
                ("keypoint_names", model.keypoint_names, self.keypoint_names),
                ("lowest score", model.thresholds.score, self.thresholds.score),
                ("score_input", model.thresholds.score_input, self.thresholds.score_input),
                ("opset", model.opset, self.opset),
                ("precision", model.precision, self.precision),
                ("weight_bits", model.weight_bits, self.weight_bits),
                ("target", model.target, self.target),
            ):
                require(value == expected, f"{where}: {name}", value, f"{expected}, as {self.name}")

    def shown(self, image: str | None) -> Manifest:
        """The description of the model that runs where one image alone is shown.

        Args:
            image: `colour` or `depth`; None for both.

        Returns:
            One of `alone`; this manifest for both images, and where the file has one model.
        """
        return self if image is None else self.alone.get(image, self)

    @property
    def takes_depth(self) -> bool:
        """Whether the model takes depth images alone."""
        return self.modality == "depth"

    @property
    def takes_both(self) -> bool:
        """Whether the model takes colour and depth together, or either."""
        return self.modality == "both"

    @property
    def images(self) -> str:
        """The kind of images that the model takes, in words."""
        return {"rgb": "colour", "depth": "depth", "both": "colour and depth"}[self.modality]

    @property
    def graph_inputs(self) -> dict[str, InputSpec]:
        """The graph's inputs by kind, `colour` and `depth`, in the graph's order."""
        if self.inputs:
            return {each.name: each for each in self.inputs}
        return {DEPTH if self.takes_depth else COLOUR: self.input}

    def pad_value_of(self, target: InputSpec) -> int:
        """Value of the letterbox borders of an input."""
        return self.resize.pad_value if target.pad_value is None else target.pad_value

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in the graph's order."""
        return tuple(output.name for output in self.outputs)

    def has_output(self, name: str) -> bool:
        """Whether the model has the output `name`."""
        return name in self.output_names

    def to_json(self) -> str:
        """The manifest as JSON text, for the metadata of the model file."""
        return json.dumps(dataclasses.asdict(self), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Manifest:
        """Parse the output of `to_json`.

        Raises:
            ModelFileError: The text is not JSON, has another schema, or a field is missing or has
                the wrong type.
        """
        try:
            data = parse_json(text)
        except ValueError as error:
            raise ModelFileError(f"manifest: not JSON ({error})") from error
        schema = data.get("schema") if isinstance(data, dict) else None
        require(schema == SCHEMA, "schema", schema, repr(SCHEMA))
        try:
            return build(cls, data, "manifest")
        except InputError as error:
            raise ModelFileError(str(error)) from error


def optional_inputs(manifest: Manifest) -> dict[str, tuple[int | str, ...]]:
    """Shapes of the inputs that have a default in the graph, by name."""
    name = manifest.thresholds.score_input
    return {} if name is None else {name: (1,)}
