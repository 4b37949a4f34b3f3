"""What a program found in the frames of a kit, and its file."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

from msgspec import Meta

from basetree.errors import InputError
from basetree.files.json import read_json
from basetree.files.writing import text_file
from edgetree.detections import KEYPOINT_NAMES, MASK_SIZE, TreeDetections

RESULTS_SCHEMA: Final = "edgetree.conformance-results/1"
_DIGITS: Final = 4
_CELLS: Final = MASK_SIZE * MASK_SIZE
_LARGEST_BYTES: Final = 16 * 2**20  # a tree with its mask has about 6000
MOST_FRAMES: Final = 50
_MOST_TREES: Final = 200  # of a frame; networks find 100

_Number = Annotated[float, Meta(ge=-1e6, le=1e6)]
_Four = tuple[_Number, _Number, _Number, _Number]
_Point = tuple[_Number, _Number, _Number]


@dataclass(frozen=True)
class FoundTree:
    """One tree.

    Attributes:
        score: Probability of being a tree.
        box_px: x0, y0, x1, y1 in pixels of the frame, not clipped to it.
        keypoints_px: x, y, score of each keypoint in the manifest's order; None if the model has
            no keypoints.
        mask: Probabilities on the grid over the box, row by row; None if the model has no masks.
    """

    score: _Number
    box_px: _Four
    keypoints_px: tuple[_Point, ...] | None = None
    mask: tuple[_Number, ...] | None = None

    def __post_init__(self) -> None:
        for name, expected in (("keypoints_px", len(KEYPOINT_NAMES)), ("mask", _CELLS)):
            values = getattr(self, name)
            if values is not None and len(values) != expected:
                raise InputError(f"{name} has {len(values)} values: expected {expected}")


@dataclass(frozen=True)
class CoveredTree:
    """A tree that is left out, since its mask and that of a better tree cover each other.

    Attributes:
        by: Index of the better tree.
        tree: The tree.
    """

    by: Annotated[int, Meta(ge=0)]
    tree: FoundTree


@dataclass(frozen=True)
class FrameTrees:
    """The trees in one frame.

    Attributes:
        name: Name of the frame.
        trees: The trees, by descending score.
        covered: Trees that were left out; only in what a kit expects.
    """

    name: str
    trees: Annotated[tuple[FoundTree, ...], Meta(max_length=_MOST_TREES)]
    covered: Annotated[tuple[CoveredTree, ...], Meta(max_length=_MOST_TREES)] = ()


@dataclass(frozen=True)
class Results:
    """What a program found in all frames of a kit.

    Attributes:
        model_sha256: Hash of the model file, as the kit names it.
        runtime: What ran the network, such as "onnxruntime" or "openvino".
        runtime_version: Its version.
        processor: "x86-64", "arm64", "wasm" or another word.
        frames: The trees of each frame.
        host: Name of the program.
        median_ms: Median time from a frame in memory to its trees; None if not measured.
        threads: Threads of one inference; None if not known.
        schema: Version of this layout.
    """

    model_sha256: str
    runtime: str
    runtime_version: str
    processor: str
    frames: Annotated[tuple[FrameTrees, ...], Meta(max_length=MOST_FRAMES)]
    host: str = "a program"
    median_ms: _Number | None = None
    threads: int | None = None
    schema: str = RESULTS_SCHEMA

    @property
    def covered(self) -> int:
        """Number of trees that are left out since a better one covers them."""
        return sum(len(frame.covered) for frame in self.frames)


def found_trees(found: TreeDetections) -> tuple[FoundTree, ...]:
    """The trees of one frame as this package finds them."""
    return tuple(_tree(found, index) for index in range(len(found)))


def _tree(found: TreeDetections, index: int) -> FoundTree:
    points, masks = found.keypoints_px, found.masks
    return FoundTree(
        score=_rounded(found.scores[index]),
        box_px=_rounded(found.boxes_px[index]),
        keypoints_px=None if points is None else _rounded(points[index]),
        mask=None if masks is None else _rounded(masks[index].ravel()),
    )


def _rounded(values: Any) -> Any:
    """A number or an array as numbers and tuples of a few digits."""
    if values.ndim:
        return tuple(_rounded(value) for value in values)
    return round(float(values), _DIGITS)


def read_results(path: Path) -> Results:
    """Read the file that a program wrote.

    Raises:
        InputError: The file is missing, has another schema, or a value is missing or of another
            type; the message names the value.
    """
    what = "what a program found in a kit"
    return read_json(path, RESULTS_SCHEMA, Results, what, largest_bytes=_LARGEST_BYTES)


def write_results(path: Path, results: Results) -> None:
    """Write results as JSON.

    Raises:
        InputError: The file cannot be written.
    """
    with text_file(path) as stream:
        json.dump(dataclasses.asdict(results), stream, allow_nan=False)
        stream.write("\n")
