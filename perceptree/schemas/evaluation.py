"""Types of the results of `perceptree eval` and `perceptree predict`. Units are in the names."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from basetree.schemas import Count, Share, Sides
from calib.schemas import RunLengths

Percent = Annotated[float, Meta(ge=0, le=100)]


class Model(TypedDict):
    """The network or the file that was evaluated."""

    name: str
    path: NotRequired[str]
    kind: NotRequired[str]
    backbone: NotRequired[str | None]
    modality: Literal["rgb", "depth", "both"]
    precision: str
    provider: NotRequired[str]
    input_px: Sides
    detections: NotRequired[Count]
    lowest_score: NotRequired[Share]
    training: NotRequired[dict[str, Any] | str | None]
    weights_sha256: NotRequired[str]


class Data(TypedDict):
    """The labelled frames."""

    folder: str
    split: str
    frames: Count
    trees: Count
    crowds: Count
    ignored: Count
    picture_px: dict[str, int]
    notes: list[str]


class AveragePrecision(TypedDict):
    """COCO's average precisions in percent."""

    ap: Percent
    ap50: Percent
    ap75: Percent
    ap_small: Percent | None
    ap_medium: Percent | None
    ap_large: Percent | None


class Counts(TypedDict):
    """Trees found, missed and invented."""

    found: Count
    missed: Count
    invented: Count
    recall: Share
    precision: Share | None


class AtScore(Counts):
    """Counts of detections from a score on."""

    score: Share
    iou: Share


class DistanceGroup(TypedDict):
    """Trees of a range of distances."""

    name: str
    trees: Count
    found: Count
    recall: Share


class RuleCounts(Counts):
    """Counts by one rule."""

    by_distance: list[DistanceGroup]


class Certain(TypedDict):
    """Counts with trees beyond a distance ignored, and with all of them."""

    certain_m: float
    graded: RuleCounts
    plain: RuleCounts


class ScoreRow(TypedDict):
    """Recall and precision from a score on."""

    score: Share
    recall: Share
    precision: Share | None


Bin = TypedDict(
    "Bin",
    {
        "from": Share,
        "to": Share,
        "detections": Count,
        "mean_score": Share | None,
        "right": Share | None,
    },
)
Bin.__doc__ = "Detections of a range of scores, and the share that is right."


class Reliability(TypedDict):
    """Whether scores are probabilities."""

    least_score: Share
    detections: Count
    expected_error: Share | None
    bins: list[Bin]


class Histogram(TypedDict):
    """Counts of errors in equal bins, and the number beyond them."""

    from_px: float
    to_px: float
    counts: list[int]
    beyond: Count


class Density(TypedDict):
    """Counts of errors in the plane, rows downwards, and the number beyond them."""

    from_px: float
    to_px: float
    rows: list[list[int]]
    beyond: Count


class Spread(TypedDict):
    """Statistics of errors in px."""

    count: Count
    mean: float
    median: float
    median_abs: float
    mean_abs: float
    sigma: float
    p90_abs: float
    histogram: Histogram


class Group(TypedDict):
    """Results of a group of trees; precision where the groups are of frames."""

    name: str
    frames: Count
    trees: Count
    recall: Share
    precision: NotRequired[Share | None]
    boxes_ap: Percent | None
    masks_ap: Percent | None
    keypoints_ap: Percent | None
    felling_cut_median_px: NotRequired[float | None]
    diameter_mean_abs_px: NotRequired[float | None]
    diameter_bias_px: NotRequired[float | None]


class Axis(TypedDict):
    """A condition and its groups."""

    title: str
    of_frames: bool
    groups: list[Group]


class Evaluation(TypedDict):
    """`report.json`, and `perceptree eval --json` and `edgetree eval --json`."""

    schema: Literal["perceptree.evaluation/1"]
    model: Model
    data: Data
    average_precision: dict[str, AveragePrecision | None]
    precision_at_recall: dict[str, list[Share] | None]
    at_score: AtScore
    certain: Certain | None
    boxes_by_score: list[ScoreRow] | None
    reliability: Reliability
    keypoint_error_px: dict[str, dict[str, Spread | None]] | None
    felling_cut_density: Density | None
    diameter_error_px: Spread | None
    by: dict[str, Axis]
    left_out: list[str]


class Predict(TypedDict):
    """`perceptree predict --json`."""

    schema: Literal["perceptree.predict/1"]
    pictures: Count
    trees: Count
    out: str
    labels: str


class Prediction(TypedDict):
    """What was found in a frame: boxes x0, y0, x1, y1 in px, best score first."""

    boxes: list[Annotated[list[float], Meta(min_length=4, max_length=4)]]
    scores: list[float]
    keypoints: list[list[list[float]]] | None
    masks: list[RunLengths] | None


Predictions = Annotated[
    list[Prediction],
    Meta(description="A part of `perceptree eval --shards`: a block of frames, without a key."),
]
