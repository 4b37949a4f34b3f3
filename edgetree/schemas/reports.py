"""Types of what commands print about cameras, machines, model files and programs."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import UNSET, Meta, UnsetType, defstruct

from basetree.schemas import Count, Share, Sides
from calib.boards.result import Dropped, Parameter, ViewResult
from calib.schemas import Camera
from edgetree.conformance.compare import Quantity
from edgetree.conformance.tolerances import Tolerance
from edgetree.demo.comparison import QUANTITIES
from edgetree.doctor import Libraries, Machine, ModelFile, ProviderResult, Speed
from edgetree.schemas.commands import DepthScale
from edgetree.schemas.results import METRES_FIELDS, Evidence


class Calibrate(TypedDict):
    """`edgetree calibrate --json`; without a camera only what is always there."""

    schema: Literal["edgetree.calibrate/1"]
    source: str
    board: str
    model: Literal["radtan", "fisheye"]
    pictures: Count
    without_board: list[str]
    repeated: list[str]
    seen_in_part: dict[str, str]
    passed: bool
    reasons: list[str]
    advice: list[str]
    dropped: list[Dropped]
    camera: NotRequired[Camera]
    parameters: NotRequired[list[Parameter]]
    rms_px: NotRequired[float]
    coverage: NotRequired[Share]
    views_per_cell: NotRequired[list[list[int]]]
    views: NotRequired[list[ViewResult]]
    depth_scale: DepthScale | None
    depth_failure: str | None
    camera_file: str | None
    depth_scale_file: str | None
    left_out: NotRequired[list[str]]


class CheckOfRig(TypedDict):
    """One check of a rig."""

    check: str
    group: str
    verdict: Literal["holds", "does not hold", "cannot tell"]
    value: float | None
    half_interval95: float | None
    limit: float | None
    unit: str
    reason: str


class CheckRig(TypedDict):
    """`edgetree check-rig --json`."""

    schema: Literal["edgetree.check-rig/1"]
    source: str
    seconds: float
    frames: Count
    used_frames: Count
    silhouettes: Count
    stems: Count
    checks: list[CheckOfRig]
    passed: bool


class AdviceText(TypedDict):
    """What to do, or to know."""

    level: str
    text: str


class Doctor(TypedDict):
    """`edgetree doctor --json`."""

    schema: Literal["edgetree.doctor/1"]
    healthy: bool
    machine: Machine
    libraries: Libraries
    providers: list[ProviderResult]
    speed: Speed | None
    video: dict[str, bool]
    models: list[ModelFile]
    advice: list[AdviceText]


class Change(TypedDict):
    """How a row of `edgetree bench` changed."""

    row: str
    old_ms: float
    new_ms: float
    ratio: float
    noise: float
    lost_ap: dict[str, float]
    not_compared: str
    slower: bool
    faster: bool


class BenchComparison(TypedDict):
    """`edgetree compare --json`."""

    schema: Literal["edgetree.bench-comparison/1"]
    rows: list[Change]
    only_old: list[str]
    only_new: list[str]
    machines: Annotated[list[str], Meta(min_length=2, max_length=2)] | None
    regressions: Count


class ConformanceMake(TypedDict):
    """`edgetree conformance make --json`."""

    schema: Literal["edgetree.conformance-make/1"]
    kit: str
    model_sha256: str
    frames: Count
    trees: Count
    covered: Count


class ConformanceCheck(TypedDict):
    """`edgetree conformance check --json`."""

    schema: Literal["edgetree.conformance-check/1"]
    passed: bool
    host: str | None
    runtime: str
    processor: str
    median_ms: float | None
    trees: Count
    unmatched: Count
    quantities: list[Quantity]
    tolerance: Tolerance
    problems: list[str]


DemoTree = defstruct(
    "DemoTree",
    [
        ("frame", str),
        ("found", bool),
        ("score", Share | None),
        *((f"true_{quantity}", float) for quantity in QUANTITIES),
        *((name, kind | UnsetType, UNSET) for name, kind, _ in METRES_FIELDS),
        ("evidence", Evidence | UnsetType, UNSET),
    ],
    kw_only=True,
)
"""A tree of the demo: the truth, and what was measured if it was found."""


class DemoErrors(TypedDict):
    """Errors of one quantity; null where nothing was measured."""

    measured: Count
    median_abs_error_m: float | None
    median_relative_error: float | None
    within_one_std: Share | None
    within_two_std: Share | None


class DemoModel(TypedDict):
    """What a model found in the sample frames."""

    modality: Literal["rgb", "depth", "both"]
    name: str
    precision: str
    input_width_px: Count
    input_height_px: Count
    file_bytes: Count
    threads: int | None
    latency_p50_ms: float
    latency_p90_ms: float
    fps_p50: float
    fps_p90: float
    true_trees: Count
    found_trees: Count
    unmatched_detections: Count
    errors: dict[str, DemoErrors]
    trees: list[DemoTree]  # type: ignore[valid-type]


class Demo(TypedDict):
    """`edgetree demo --json`."""

    schema: Literal["edgetree.demo/1"]
    report: str
    duration_s: float
    peak_memory_mib: float | None
    models: dict[str, DemoModel]
    training: NotRequired[dict[str, Any]]


class AveragePrecisions(TypedDict):
    """Of the checkpoint's model and of the file, percent."""

    model: float
    file: float


class Parity(TypedDict):
    """How far a file differs from its checkpoint: the largest differences."""

    frames: Count
    trees_compared: Count
    matched_fraction: Share
    box_px_max: float
    keypoint_px_max: float
    keypoint_std_px_max: NotRequired[float]
    score_max: float
    keypoint_score_max: float
    mask_probability_max: float
    keypoint_ties: Count
    mask_iou_min: Share
    percentiles: dict[str, float | None]
    average_precision: dict[str, AveragePrecisions]
    not_checked: list[str]
    limits: dict[str, Any]


class Export(TypedDict):
    """`edgetree export --json` and `edgetree verify --json`."""

    schema: Literal["edgetree.export/1"]
    model: str
    name: str
    modality: Literal["rgb", "depth", "both"]
    precision: str
    provider: str
    input_px: Sides
    batch: Count
    proposals: Count | None
    opset: Count
    multiply_adds: Count | None
    parameters: Count
    file_bytes: Count
    weights_sha256: str
    parity: Parity
