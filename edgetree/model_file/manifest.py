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
from dataclasses import dataclass
from typing import Any, Final

from basetree.errors import InputError
from basetree.files.json import build, parse_json
from edgetree.detections import ERROR_FACTORS, KEYPOINT_NAMES, MASK_SIZE
from edgetree.errors import ModelFileError

METADATA_KEY: Final = "edgetree.manifest"
SCHEMA: Final = "edgetree.manifest/1"
RESIZE_RULE: Final = "letterbox-top-left"
_LAYOUTS: Final = {"rgb": "BHWC", "depth": "BHW"}
_CHANNELS: Final = {"rgb": (3,), "depth": (1, 3)}
_COLOUR_ORDERS: Final = {"rgb": "BGR", "depth": "depth"}


def _require(condition: bool, what: str, value: object, expected: str) -> None:
    if not condition:
        raise ModelFileError(f"manifest: {what} is {value!r}: expected {expected}")


@dataclass(frozen=True)
class InputSpec:
    """The graph's only input.

    Attributes:
        name: Name of the input.
        height: Height in pixels.
        width: Width in pixels.
        layout: The axes, "BHWC" for rgb models and "BHW" for depth models.
        dtype: Always "uint8".
        colour_order: "BGR" or "depth".
        batch_sizes: Batch sizes that the export has verified.

    Raises:
        ModelFileError: a value is out of range.
    """

    name: str
    height: int
    width: int
    layout: str
    dtype: str
    colour_order: str
    batch_sizes: tuple[int, ...] = (1,)

    def __post_init__(self) -> None:
        _require(min(self.height, self.width) >= 32, "input size", self.size_text, "32x32 or more")
        _require(self.dtype == "uint8", "input dtype", self.dtype, "'uint8'")
        sizes = self.batch_sizes
        expected = "at least one number, all of them 1 or more"
        _require(bool(sizes) and min(sizes) > 0, "input batch_sizes", sizes, expected)

    @property
    def size_text(self) -> str:
        """WIDTHxHEIGHT in pixels, for messages."""
        return f"{self.width}x{self.height}"

    @property
    def image_shape(self) -> tuple[int, ...]:
        """Shape of one image: (H, W, 3) or (H, W)."""
        return (self.height, self.width, 3)[: len(self.layout) - 1]


@dataclass(frozen=True)
class OutputSpec:
    """One output of the graph. In `shape`, the text "B" stands for the batch size."""

    name: str
    shape: tuple[int | str, ...]
    dtype: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class ResizeRule:
    """How images are resized to the input: `calib.Letterbox`, padded with `pad_value` (0-255)."""

    rule: str = RESIZE_RULE
    pad_value: int = 0

    def __post_init__(self) -> None:
        _require(self.rule == RESIZE_RULE, "resize rule", self.rule, repr(RESIZE_RULE))
        _require(0 <= self.pad_value <= 255, "resize pad_value", self.pad_value, "0 to 255")


@dataclass(frozen=True)
class Thresholds:
    """Thresholds for the outputs.

    Attributes:
        score: Lowest score that the graph outputs.
        nms_iou: IoU of boxes above which the graph keeps the one with the higher score.
        mask_overlap: After the graph, of two trees whose masks have more than this share of the
            smaller one in common, the one with the higher score is kept.
    """

    score: float
    nms_iou: float
    mask_overlap: float = 0.8

    def __post_init__(self) -> None:
        for name in ("score", "nms_iou", "mask_overlap"):
            value = getattr(self, name)
            _require(0.0 <= value <= 1.0, f"threshold {name}", value, "0 to 1")


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
        _require(is_range, f"range of {self.statistic}", found, "low <= high")


@dataclass(frozen=True)
class Manifest:
    """Description of a model file.

    Attributes:
        name: Name of the model.
        backbone: Name of its backbone.
        modality: "rgb" or "depth", the kind of image that the model takes.
        input: The graph's input.
        resize: How images are resized to the input.
        mean: Mean per channel, in the input's colour order; the graph subtracts it from the uint8
            values. Three values for a depth model that repeats its channel three times.
        std: Standard deviation per channel, likewise; the graph divides by it.
        depth_encoding: `calib.DepthEncoding.to_dict()` of a depth model, else None.
        outputs: The graph's outputs, see `standard_outputs`.
        classes: Names of the classes.
        keypoint_names: `KEYPOINT_NAMES`, or empty for a model without keypoints.
        keypoint_flip_pairs: Pairs of keypoint indices that a horizontal flip swaps.
        thresholds: Thresholds for the outputs.
        precision: "float32", "float16" or "int8".
        opset: ONNX opset of the graph.
        parameters: Number of weights.
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
    schema: str = SCHEMA

    def __post_init__(self) -> None:
        _require(self.schema == SCHEMA, "schema", self.schema, repr(SCHEMA))
        _require(self.modality in _LAYOUTS, "modality", self.modality, "'rgb' or 'depth'")
        smallest, largest = ERROR_FACTORS
        plausible = smallest <= self.error_factor <= largest
        expected = f"{smallest:g} to {largest:g}"
        _require(plausible, "error_factor", self.error_factor, expected)
        layout, order = _LAYOUTS[self.modality], _COLOUR_ORDERS[self.modality]
        _require(self.input.layout == layout, "input layout", self.input.layout, repr(layout))
        colour = self.input.colour_order
        _require(colour == order, "input colour_order", colour, repr(order))
        for name in ("mean", "std"):
            values = getattr(self, name)
            allowed = _CHANNELS[self.modality]
            expected = f"{' or '.join(map(str, allowed))} number(s)"
            _require(len(values) in allowed, name, values, expected)
        has_encoding = self.depth_encoding is not None
        expected = "a depth encoding for a depth model, and null for an rgb model"
        _require(has_encoding == self.takes_depth, "depth_encoding", self.depth_encoding, expected)
        names = self.keypoint_names
        expected_names = KEYPOINT_NAMES if self.has_output("keypoints") else ()
        _require(names == expected_names, "keypoint_names", names, repr(expected_names))
        needed = {"boxes", "scores", "num_detections"}
        _require(all(map(self.has_output, needed)), "outputs", self.output_names, f"{needed}")

    @property
    def takes_depth(self) -> bool:
        """Whether the model takes depth images; otherwise it takes colour images."""
        return self.modality == "depth"

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
        _require(schema == SCHEMA, "schema", schema, repr(SCHEMA))
        try:
            return build(cls, data, "manifest")
        except InputError as error:
            raise ModelFileError(str(error)) from error


def standard_input(modality: str, height: int, width: int) -> InputSpec:
    """The input of all models of this project for a modality, "rgb" or "depth".

    Raises:
        ModelFileError: Another modality, or a size below 32x32 px.
    """
    _require(modality in _LAYOUTS, "modality", modality, "'rgb' or 'depth'")
    layout, order = _LAYOUTS[modality], _COLOUR_ORDERS[modality]
    return InputSpec("image", height, width, layout, "uint8", order)


def standard_outputs(
    detections: int, *, keypoints: bool = True, masks: bool = True
) -> tuple[OutputSpec, ...]:
    """The outputs of all models of this project, in their order.

    Args:
        detections: Number of rows per image. Rows from `num_detections` on are zero.
        keypoints: Whether the model has a keypoint output.
        masks: Whether the model has a mask output.
    """
    rows: tuple[int | str, ...] = ("B", detections)
    boxes = OutputSpec("boxes", (*rows, 4), "float32", "px of the input", "x0, y0, x1, y1")
    scores = OutputSpec("scores", rows, "float32", "1", "probability of a tree, descending")
    points = OutputSpec(
        "keypoints",
        (*rows, len(KEYPOINT_NAMES), 3),
        "float32",
        "px of the input, px of the input, 1",
        "x, y, score (softmax peak)",
    )
    grids = OutputSpec(
        "masks",
        (*rows, MASK_SIZE, MASK_SIZE),
        "float32",
        "1",
        "probability on a grid over the box",
    )
    count = OutputSpec("num_detections", ("B",), "int64", "1", "rows in use")
    return (boxes, scores, *([points] * keypoints), *([grids] * masks), count)
