"""Numbers of the paper's tables 2 and 3.

Grondin, Pomerleau and Giguère (2022), "Training Deep Learning Algorithms on Synthetic Forest Images
for Tree Detection". All are COCO average precisions in percent, of one run each.
"""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.models.spec import Modality

MEASURES = {
    "box_ap": "AP bb",
    "mask_ap": "AP mask",
    "keypoint_ap": "AP kp",
    "box_ap50": "AP50 bb",
    "mask_ap50": "AP50 mask",
}
"""Fields of `perceptree.evaluation.Metrics` and their names in the paper."""

MASK_ONLY, BOTH, KEYPOINT_ONLY = "mask-only", "keypoint & mask", "keypoint-only"


@dataclass(frozen=True)
class PaperRow:
    """A row of a table.

    Attributes:
        backbone: Backbone as the paper names it.
        modality: "RGB" or "Depth".
        scores: Average precisions in percent, by field of `perceptree.evaluation.Metrics`.
    """

    backbone: str
    modality: str
    scores: dict[str, float]


_TABLE_2_MEASURES = ("box_ap", "mask_ap", "box_ap50", "mask_ap50")
_TABLE_3_MEASURES = ("box_ap", "mask_ap", "keypoint_ap")
TABLE_MEASURES = {2: _TABLE_2_MEASURES, 3: _TABLE_3_MEASURES}


def _row(backbone: str, modality: str, *scores: float) -> PaperRow:
    return PaperRow(backbone, modality, dict(zip(_TABLE_2_MEASURES, scores, strict=True)))


# LaTeX label tab:AP_synth. The published X-101 weights are 32x8d.
TABLE_2: dict[tuple[str, Modality], PaperRow] = {
    ("r50", "rgb"): _row("R-50", "RGB", 55.20, 31.13, 87.74, 69.36),
    ("r50", "depth"): _row("R-50", "Depth", 66.70, 31.52, 89.67, 70.66),
    ("r101", "rgb"): _row("R-101", "RGB", 56.79, 31.72, 88.51, 70.53),
    ("r101", "depth"): _row("R-101", "Depth", 68.20, 31.98, 89.89, 71.65),
    ("x101-32x8d", "rgb"): _row("X-101", "RGB", 58.34, 31.77, 88.91, 71.07),
    ("x101-32x8d", "depth"): _row("X-101", "Depth", 63.90, 28.86, 87.41, 68.19),
}
"""By preset and modality: box AP, mask AP, and both at an overlap of 0.50."""

# LaTeX label tab:multi-task_learning.
TABLE_3 = {
    MASK_ONLY: PaperRow("X-101", "RGB", {"box_ap": 59.25, "mask_ap": 32.65}),
    BOTH: PaperRow("X-101", "RGB", {"box_ap": 58.34, "mask_ap": 31.77, "keypoint_ap": 80.19}),
    KEYPOINT_ONLY: PaperRow("X-101", "RGB", {"box_ap": 57.71, "keypoint_ap": 80.13}),
}
"""By tasks, all for RGB: box AP, mask AP, keypoint AP."""

CONDITIONS = {
    "data": "SynthTree43k: 40,000 training frames, 2,000 test frames",
    "schedule": (
        "Detectron2 from weights for COCO's person keypoints, SGD, early stopping on val AP within"
        " 60,000 steps of 4 to 8 frames, 1280x720 px"
    ),
    "seeds": "one run each, without a standard deviation",
}
NOTES = {
    2: "The paper's X-101 is ResNeXt-101 32x8d, according to its published weights.",
    3: (
        "The paper's table 3 is for ResNeXt-101 on RGB. Its caption says real images, but its row"
        f" '{BOTH}' equals table 2's on SynthTree43k."
    ),
}
