"""Types of the files of `perceptree tables`. Units are in the names."""

from __future__ import annotations

from typing import Any, Literal, TypedDict

from basetree.schemas import Count
from perceptree.schemas.training import Metrics, Network


class TrainingData(TypedDict):
    """Data that a run is trained on."""

    folder: str
    train_labels_sha256: str
    val_labels_sha256: str


class WantedTraining(TypedDict):
    """What decides a training."""

    spec: Network
    settings: dict[str, Any]
    init: dict[str, Any]
    data: TrainingData


class Made(TypedDict):
    """How a training went."""

    steps: Count
    elapsed_s: float
    frames: Count
    precision: str
    device: str
    val: Metrics


class TestData(TypedDict):
    """Data that a run is tested on."""

    folder: str
    labels_sha256: str


class TableRun(TypedDict):
    """`result.json` of a run of a table."""

    schema: Literal["perceptree.table-run/1"]
    training: WantedTraining
    made: Made
    test: TestData
    metrics: Metrics


class Conditions(TypedDict):
    """What all runs share; lists where they may differ."""

    data: str
    frames: Count
    test: str
    test_frames: Count
    test_trees: Count
    recipes: list[str]
    schedule: str
    steps: Count | None
    minutes: float | None
    batches: list[int]
    inputs_px: list[list[int]]
    starting_weights: list[str | None]
    precisions: list[str]
    devices: list[str]
    seeds: list[int]


class Score(TypedDict):
    """A measure of each seed, the mean, and the deviation of several."""

    each: list[float]
    mean: float
    deviation: float | None


class PaperScores(TypedDict):
    """The paper's row."""

    backbone: str
    modality: str
    scores: dict[str, float]


class Row(TypedDict):
    """A row of a table."""

    tasks: str
    model: str
    modality: Literal["rgb", "depth", "both"]
    seeds: list[int]
    steps: list[int]
    scores: dict[str, Score | None]
    paper: PaperScores | None


class Claim(TypedDict):
    """A claim of the paper, and what the runs say to it."""

    claim: str
    measure: str
    paper_difference: float | None
    difference: float | None
    interval: float | None
    word: Literal["agrees", "disagrees", "undecided"]


class Table(TypedDict):
    """A table of the runs that are finished."""

    table: Literal[2, 3]
    finished_runs: Count
    runs: Count
    conditions: Conditions
    rows: list[Row]
    claims: list[Claim]


class PrintedTable(Table):
    """`perceptree tables --json`."""

    schema: Literal["perceptree.table/1"]


class Tables(TypedDict):
    """`tables.json`, by the number of the table."""

    schema: Literal["perceptree.tables/1"]
    tables: dict[str, Table]
