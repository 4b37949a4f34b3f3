"""The manifest: what a model file says about itself.

It is one JSON value in the ONNX file's metadata, under `METADATA_KEY`. Export writes it, and the
runtime reads nothing else: sizes, colour order, resizing, encodings and names all come from here.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from edgetree.detections import KEYPOINT_NAMES, MASK_SIZE
from edgetree.errors import ModelFileError
from edgetree.model_file.json_fields import build

__all__ = [
    "METADATA_KEY",
    "SCHEMA",
    "ClassifierCost",
    "InputSpec",
    "Manifest",
    "OutputSpec",
    "ResizeRule",
    "Thresholds",
    "standard_input",
    "standard_outputs",
]

METADATA_KEY: Final = "edgetree.manifest"
SCHEMA: Final = "edgetree.manifest/1"
RESIZE_RULE: Final = "letterbox-top-left"
_LAYOUTS: Final = {"rgb": "BHWC", "depth": "BHW"}
_CHANNELS: Final = {"rgb": (3,), "depth": (1, 3)}
_COLOUR_ORDERS: Final = {"rgb": "BGR", "depth": "depth"}


def _require(condition: bool, what: str, value: object, expected: str) -> None:
    if not condition:
        raise ModelFileError(f"manifest: {what} is {value!r}: expected {expected}")


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not a JSON number")


@dataclass(frozen=True)
class InputSpec:
    """The graph's one input. `layout` names the axes; `batch_sizes` are the verified ones."""

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
        _require(bool(sizes) and min(sizes) > 0, "input batch_sizes", sizes, "some, 1 or more each")

    @property
    def size_text(self) -> str:
        """Width x height in pixels, for messages."""
        return f"{self.width}x{self.height}"

    @property
    def image_shape(self) -> tuple[int, ...]:
        """One image's shape: (H, W, 3) or (H, W)."""
        return (self.height, self.width, 3)[: len(self.layout) - 1]


@dataclass(frozen=True)
class OutputSpec:
    """One output: `shape` holds numbers, and "B" for the batch."""

    name: str
    shape: tuple[int | str, ...]
    dtype: str
    unit: str
    meaning: str


@dataclass(frozen=True)
class ResizeRule:
    """How an image comes to the input's size: `calib.Letterbox`, padded with `pad_value`."""

    rule: str = RESIZE_RULE
    pad_value: int = 0

    def __post_init__(self) -> None:
        _require(self.rule == RESIZE_RULE, "resize rule", self.rule, repr(RESIZE_RULE))
        _require(0 <= self.pad_value <= 255, "resize pad_value", self.pad_value, "0 to 255")


@dataclass(frozen=True)
class Thresholds:
    """What the graph itself applies: the lowest score it keeps, and the IoU of its suppression."""

    score: float
    nms_iou: float

    def __post_init__(self) -> None:
        for name in ("score", "nms_iou"):
            value = getattr(self, name)
            _require(0.0 <= value <= 1.0, f"threshold {name}", value, "0 to 1")


@dataclass(frozen=True)
class ClassifierCost:
    """Of the backbone as an ImageNet classifier, for one 224x224 px image, as papers count it."""

    parameters: int
    multiply_adds: int


@dataclass(frozen=True)
class Manifest:
    """Everything that a program needs to know to use a model file.

    Attributes:
        name: name of the model.
        backbone: name of its backbone.
        modality: "rgb" or "depth".
        input: the graph's input.
        resize: how an image is brought to that size.
        mean: per input channel, in its colour order; the graph subtracts it from the bytes. Three
            for a depth model that takes its one channel as three equal ones.
        std: likewise; the graph divides by it.
        depth_encoding: `calib.DepthEncoding.to_dict()` of a depth model, else None.
        outputs: the graph's outputs, see `standard_outputs`.
        classes: names of the classes.
        keypoint_names: `KEYPOINT_NAMES`, or empty for a model without keypoints.
        keypoint_flip_pairs: pairs of keypoint indices that change places on a horizontal flip.
        thresholds: what the graph applies.
        precision: "float32", "float16" or "int8".
        opset: ONNX opset of the graph.
        parameters: number of weights.
        weights_sha256: of the checkpoint's weights.
        training_data: id of the data the weights were trained on.
        project_version: version of edgetree that wrote the file.
        parity: figures of the export's parity check.
        calibration_sha256: of the data that a quantised model was calibrated on, else None.
        proposals: regions per frame that the box head looks at; None in older files.
        multiply_adds: of one frame through the whole network; None in older files.
        classifier: cost of the backbone alone, as papers give it; None in older files.
        target: the provider that the file was made for.
        schema: version of this layout.

    Raises:
        ModelFileError: a value does not fit the others.
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
    schema: str = SCHEMA

    def __post_init__(self) -> None:
        _require(self.schema == SCHEMA, "schema", self.schema, repr(SCHEMA))
        _require(self.modality in _LAYOUTS, "modality", self.modality, "'rgb' or 'depth'")
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
        is_depth = self.modality == "depth"
        _require(has_encoding == is_depth, "depth_encoding", self.depth_encoding, expected)
        names = self.keypoint_names
        expected_names = KEYPOINT_NAMES if self.has_output("keypoints") else ()
        _require(names == expected_names, "keypoint_names", names, repr(expected_names))
        needed = {"boxes", "scores", "num_detections"}
        _require(all(map(self.has_output, needed)), "outputs", self.output_names, f"{needed}")

    @property
    def output_names(self) -> tuple[str, ...]:
        """Names of the outputs, in the graph's order."""
        return tuple(output.name for output in self.outputs)

    def has_output(self, name: str) -> bool:
        """Whether the model has this output."""
        return name in self.output_names

    def to_json(self) -> str:
        """The one JSON value that goes into the model file."""
        return json.dumps(dataclasses.asdict(self), allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Manifest:
        """Read what `to_json` wrote.

        Raises:
            ModelFileError: no JSON, another schema, a field missing or of the wrong kind.
        """
        try:
            data = json.loads(text, parse_constant=_refuse_constant)
        except (ValueError, RecursionError) as error:
            raise ModelFileError(f"manifest: not JSON ({error})") from error
        schema = data.get("schema") if isinstance(data, dict) else None
        _require(schema == SCHEMA, "schema", schema, repr(SCHEMA))
        return build(cls, data, "manifest")


def standard_input(modality: str, height: int, width: int) -> InputSpec:
    """The input that every model of this project has for its modality."""
    _require(modality in _LAYOUTS, "modality", modality, "'rgb' or 'depth'")
    layout, order = _LAYOUTS[modality], _COLOUR_ORDERS[modality]
    return InputSpec("image", height, width, layout, "uint8", order)


def standard_outputs(
    detections: int, *, keypoints: bool = True, masks: bool = True
) -> tuple[OutputSpec, ...]:
    """The outputs of a graph that keeps `detections` rows, in their order.

    Rows past `num_detections` are zero.
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
