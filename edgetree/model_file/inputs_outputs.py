"""Inputs and outputs of the graphs, as a manifest describes them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from edgetree.detections import KEYPOINT_NAMES, MASK_SIZE
from edgetree.errors import ModelFileError

COLOUR: Final = "colour"
DEPTH: Final = "depth"
LAYOUTS: Final = {"rgb": "BHWC", "depth": "BHW", "both": "BHW"}
COLOUR_ORDERS: Final = {"rgb": "BGR", "depth": "depth", "both": "depth"}
MODALITIES: Final = "'rgb', 'depth' or 'both'"
_NO_COLOUR: Final = 0
LARGEST_BYTE: Final = 255


def require(condition: bool, what: str, value: object, expected: str) -> None:
    """Raise ModelFileError with a value of the manifest and what was expected."""
    if not condition:
        raise ModelFileError(f"manifest: {what} is {value!r}: expected {expected}")


@dataclass(frozen=True)
class InputSpec:
    """An input of the graph without a default.

    Attributes:
        name: Name of the input.
        height: Height in pixels.
        width: Width in pixels.
        layout: The axes, "BHWC" of colour and "BHW" of depth.
        dtype: Always "uint8".
        colour_order: "BGR" or "depth".
        batch_sizes: Batch sizes that the export has verified.
        pad_value: Value of the letterbox borders, where a model has several inputs; None is that of
            the manifest's `resize`.
        nothing: An image of this value alone stands for none, where a model has several inputs.

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
    pad_value: int | None = None
    nothing: int | None = None

    def __post_init__(self) -> None:
        require(min(self.height, self.width) >= 32, "input size", self.size_text, "32x32 or more")
        require(self.dtype == "uint8", "input dtype", self.dtype, "'uint8'")
        sizes = self.batch_sizes
        expected = "at least one number, all of them 1 or more"
        require(bool(sizes) and min(sizes) > 0, "input batch_sizes", sizes, expected)
        for name in ("pad_value", "nothing"):
            value = getattr(self, name)
            fits = value is None or 0 <= value <= LARGEST_BYTE
            require(fits, f"input {name}", value, f"0 to {LARGEST_BYTE}")

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


def standard_input(modality: str, height: int, width: int) -> InputSpec:
    """The input of all models of this project for a modality, "rgb" or "depth".

    Raises:
        ModelFileError: Another modality, or a size below 32x32 px.
    """
    require(modality in LAYOUTS, "modality", modality, MODALITIES)
    layout, order = LAYOUTS[modality], COLOUR_ORDERS[modality]
    return InputSpec("image", height, width, layout, "uint8", order)


def standard_inputs(
    height: int, width: int, *, pad_values: tuple[int, int], no_depth: int
) -> tuple[InputSpec, InputSpec]:
    """The colour input and the depth input of all models of this project that take both.

    Args:
        height: Height in pixels.
        width: Width in pixels.
        pad_values: Values of the letterbox borders, of colour and of depth.
        no_depth: Value of a depth without reading.

    Raises:
        ModelFileError: a value is out of range.
    """
    colour, depth = (standard_input(modality, height, width) for modality in ("rgb", "depth"))
    return (
        replace(colour, name=COLOUR, pad_value=pad_values[0], nothing=_NO_COLOUR),
        replace(depth, name=DEPTH, pad_value=pad_values[1], nothing=no_depth),
    )


def standard_outputs(
    detections: int, *, keypoints: bool = True, masks: bool = True
) -> tuple[OutputSpec, ...]:
    """The outputs of all models of this project, in their order.

    Args:
        detections: Number of rows per image. Rows from `num_detections` on are zero.
        keypoints: Whether the model has outputs of keypoints. Files made before version 0.3 have no
            `keypoint_stds`.
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
    stds = OutputSpec(
        "keypoint_stds",
        (*rows, len(KEYPOINT_NAMES), 2),
        "float32",
        "px of the input",
        "standard deviations of the heat maps in x, y",
    )
    grids = OutputSpec(
        "masks",
        (*rows, MASK_SIZE, MASK_SIZE),
        "float32",
        "1",
        "probability on a grid over the box",
    )
    count = OutputSpec("num_detections", ("B",), "int64", "1", "rows in use")
    return (boxes, scores, *([points, stds] * keypoints), *([grids] * masks), count)
