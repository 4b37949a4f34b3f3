"""Types of the card of a model file: how it was trained, and what was measured."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from basetree.schemas import Count, Sha256, Share, Side, Sides

Percent = Annotated[float, Meta(ge=0, le=100)]


class Scenes(TypedDict):
    """Simulated scenes that the file was made with, and what for."""

    use: str
    data: str
    seed: int
    scenes: Count
    frames: Count


class Training(TypedDict):
    """The last training."""

    data: str
    frames: Count
    steps: Count
    batch: Side
    learning_rate: float
    schedule: str
    seed: int
    hours: float
    device: str
    init: dict[str, Any]
    averaged_runs: Side
    score_calibration: dict[str, Any] | None
    pretrained: NotRequired[list[dict[str, Any]]]
    photographs: NotRequired[list[dict[str, Any]]]


class Precisions(TypedDict):
    """Average precision in percent."""

    boxes: Percent | None
    masks: Percent | None
    keypoints: Percent | None


class AtScore(TypedDict):
    """What is found from a score on, as number and share of the trees."""

    score: Share
    found: Count
    invented: Count
    found_share: Share
    found_share_visible_half: Share | None
    found_per_frame: float
    invented_per_frame: float
    precision: Share | None


class Weak(TypedDict):
    """The group of a condition in which the smallest share is found."""

    condition: str
    group: str
    trees: Count
    recall: Share
    boxes_ap: Percent | None


class Errors(TypedDict):
    """Errors of a quantity, in its unit; the number alone where nothing was measured."""

    trees: NotRequired[Count]
    measured: Count
    median_abs: NotRequired[float]
    p90_abs: NotRequired[float]
    bias: NotRequired[float]
    rmse: NotRequired[float]
    median_std: NotRequired[float]


class Intervals(TypedDict):
    """Share of the 95 % intervals that hold the truth; by distance with the number of trees."""

    all: Share
    by_distance: dict[str, list[float | None]]
    by_third_of_std: list[float | None]


class Metres(TypedDict):
    """Errors of the measurement."""

    quantities: dict[str, Errors]
    diameter_by_distance: dict[str, Errors]
    diameter_by_diameter: dict[str, Errors]
    diameter_by_visible_fraction: dict[str, Errors]
    intervals: dict[str, Intervals]


class Alone(TypedDict):
    """What a model of colour and depth finds with one of the two, at a score of 0.5."""

    average_precision: Precisions
    found_share: Share
    invented_per_frame: float


class Test(TypedDict):
    """What was measured on a frozen test set."""

    frames: Count
    trees: Count
    average_precision: Precisions
    at_score: AtScore
    reliability: dict[str, Any]
    diameter_error_px: float
    weakest: list[Weak]
    metres: Metres
    alone: NotRequired[dict[Literal["colour", "depth"], Alone]]


class Speed(TypedDict):
    """Time of a detection on the machine that measured."""

    machine: str
    threads: Count | None
    detect_p50_ms: float
    detect_p90_ms: float
    runs: Count


Card = TypedDict(
    "Card",
    {
        "schema": Literal["edgetree.card/1"],
        "model": str,
        "model_sha256": Sha256,
        "date": str,
        "for": str,
        "precision": str,
        "file_bytes": Count,
        "parameters": Count | None,
        "input_px": Sides,
        "training": Training | None,
        "training_scenes": list[Scenes],
        "test": NotRequired[Test],
        "field_test": NotRequired[Test],
        "speed": Speed,
    },
)
Card.__doc__ = "The file `NAME.json` beside a model file."
