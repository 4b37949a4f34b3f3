"""Types of the result of `edgetree bench`. Units are in the names."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired, TypedDict, get_type_hints

from msgspec import Meta, defstruct

from basetree.schemas import Count, Side, Sides
from edgetree.bench.paper_table import PaperRow
from edgetree.doctor import Machine

Percent = Annotated[float, Meta(ge=0, le=100)]


Environment = defstruct(
    "Environment",
    [
        ("date", str),
        *get_type_hints(Machine).items(),
        *((name, str) for name in ("edgetree", "python", "onnxruntime", "numpy", "opencv")),
    ],
)
"""The machine, when it was measured, and the versions."""


class Method(TypedDict):
    """How it was measured."""

    rounds: Side
    duration_s: float
    minutes: float
    frames: str


class Classifier(TypedDict):
    """Cost of a backbone as a classifier of 224x224 px."""

    input_px: Sides
    parameters: Count
    multiply_adds: Count
    flops: Count


class Operator(TypedDict):
    """Nodes of one operator."""

    operator: str
    provider: str
    nodes: Count
    ms: float


class Round(TypedDict):
    """Times of one round."""

    p50_ms: float
    p90_ms: float
    p99_ms: float
    fps: float
    runs: Side
    clock_mhz: float | None
    temperature_c: float | None


class Moment(TypedDict):
    """Times at one moment of a long run."""

    minute: float
    p50_ms: float
    p99_ms: float
    fps: float
    clock_mhz: float | None
    temperature_c: float | None


class Histogram(TypedDict):
    """Counts of times between edges."""

    edges_ms: list[float]
    counts: list[int]


class Accuracy(TypedDict):
    """The accuracy of a file, and what it was measured on."""

    source: str
    frames: str
    box_ap: Percent | None
    mask_ap: Percent | None
    keypoint_ap: Percent | None
    diameter_error_mm: float | None


class Row(TypedDict):
    """A model file in one way of running it."""

    name: str
    file: str
    file_bytes: Count
    file_sha256: str
    backbone: str
    modality: Literal["rgb", "depth", "both"]
    target: str
    precision: str
    provider: str
    input_px: Sides
    threads: Side
    batch: Side
    proposals: Count | None
    detections: Count
    trained: bool
    parameters: Count | None
    multiply_adds: Count | None
    flops: Count | None
    classifier: Classifier | None
    box_ap: Percent | None
    graph_batch: Side
    graph_multiply_adds: Count
    graph_flops: Count
    frames: Count
    stages_ms: dict[str, float | None]
    operators: list[Operator]
    nodes: dict[str, dict[str, int]]
    runs: Side
    p50_ms: float
    p90_ms: float
    p99_ms: float
    fps: float
    rounds: list[Round]
    histogram: Histogram
    heat: NotRequired[list[Moment]]
    load_ms: float
    trees_per_frame: float
    peak_memory_mib: float | None
    energy_j_per_frame: float | None
    giga_multiply_adds_per_s: float
    share_of_peak: float | None
    accuracy: Accuracy | None
    network: str | None
    paper: PaperRow | None


class Bench(TypedDict):
    """`edgetree bench --json` and `--out`. `peak` is by the number of threads."""

    schema: Literal["edgetree.bench/2"]
    environment: Environment  # type: ignore[valid-type]
    method: Method
    units: dict[str, str]
    paper_gpu: str
    peak: dict[str, dict[str, float | None]]
    rows: list[Row]
