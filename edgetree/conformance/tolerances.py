"""How far a program's trees may lie from the kit's, by precision, runtime and processor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from edgetree.conformance.results import Results


@dataclass(frozen=True)
class Tolerance:
    """Largest differences. Lengths are in pixels of the model's input.

    Attributes:
        score: Of the score of a tree.
        box_px: Of a side of a box; `box_share` times the longer side of the box is added, since
            the ends of stems that branches or plants hide move most.
        box_share: See `box_px`.
        keypoint_px: Of the position of a keypoint.
        keypoint_score: Of the score of a keypoint.
        mask: Of a mask, as the mean difference of its probabilities.
        outside: Share of the values of each kind that may differ by more, since a keypoint may
            jump between two peaks of its map.
        trees: Share of the trees that may be missing, or found in addition.
    """

    score: float
    box_px: float
    box_share: float
    keypoint_px: float
    keypoint_score: float
    mask: float
    outside: float
    trees: float


_EXACT: Final = Tolerance(
    score=0.01,
    box_px=0.2,
    box_share=0.0,
    keypoint_px=0.2,
    keypoint_score=0.01,
    mask=0.005,
    outside=0.08,
    trees=0.0,
)
# A grey value that is rounded the other way moves a few trees of an 8-bit network by pixels.
_ROUNDED: Final = Tolerance(
    score=0.05,
    box_px=1.5,
    box_share=0.005,
    keypoint_px=3.0,
    keypoint_score=0.05,
    mask=0.03,
    outside=0.1,
    trees=0.03,
)
# On another kind of processor, the first layers of a colour network round otherwise.
_OTHER_PROCESSOR: Final = replace(
    _ROUNDED, box_px=3.0, box_share=0.01, keypoint_px=5.0, mask=0.05, trees=0.05
)
# Another runtime rounds between other layers than onnxruntime. OpenVINO moves hidden ends of stems
# of the embedded depth file by up to 15 px, 4 to 7 % of the box's height.
_OTHER_RUNTIME: Final = replace(
    _OTHER_PROCESSOR,
    score=0.1,
    box_px=5.0,
    box_share=0.03,
    keypoint_px=6.0,
    keypoint_score=0.1,
    mask=0.1,
)


def tolerance_for(precision: str, expected: Results, found: Results) -> Tolerance:
    """The tolerance of a model's precision, between two runtimes or processors.

    Files of float32 give the same on all of them.

    Args:
        precision: "float32", "float16" or "int8".
        expected: What the kit expects, with the runtime and the processor that found it.
        found: What a program found, likewise.
    """
    if precision == "float32":
        return _EXACT
    if expected.runtime != found.runtime:
        return _OTHER_RUNTIME
    return _ROUNDED if expected.processor == found.processor else _OTHER_PROCESSOR
