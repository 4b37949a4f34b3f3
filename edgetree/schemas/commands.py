"""Types of what `--json` prints and of the files that commands write. Units are in the names."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from basetree.schemas import Count, Share, Sides, Triple
from calib.schemas import Above0, Camera, Deviation
from edgetree.schemas.results import Frame


class CameraFile(Camera):
    """A camera file."""

    schema: Literal["calib.camera/1"]


class Mounting(TypedDict):
    """The camera in the machine's frame (x forward, y left, z up)."""

    position_m: Triple
    roll_deg: NotRequired[float]
    pitch_deg: NotRequired[float]
    yaw_deg: NotRequired[float]


class TransformFile(TypedDict):
    """A transform with one way to say its rotation, or a mounting."""

    schema: Literal["calib.transform/1"]
    translation_m: NotRequired[Triple]
    rotation: NotRequired[Annotated[list[Triple], Meta(min_length=3, max_length=3)]]
    quaternion_xyzw: NotRequired[Annotated[list[float], Meta(min_length=4, max_length=4)]]
    roll_pitch_yaw_deg: NotRequired[Triple]
    mounting: NotRequired[Mounting]


class Rotated(TypedDict):
    """A transform with its rotation as a matrix."""

    rotation: Annotated[list[Triple], Meta(min_length=3, max_length=3)]
    translation_m: Triple


class StereoFile(TypedDict):
    """The calibration of a stereo pair."""

    schema: Literal["calib.stereo/1"]
    left: Camera
    right: Camera
    right_from_left: Rotated


class DepthTarget(TypedDict):
    """A target of a depth scale."""

    name: str
    distance_m: float
    residual_m: float
    noise_std_m: float
    pixels: Count


class DepthScale(TypedDict):
    """True depth = scale x reading + offset."""

    scale: Above0
    scale_std: Deviation
    offset_m: float
    offset_std_m: Deviation
    correlation: Annotated[float, Meta(ge=-1, le=1)]
    nearest_m: float
    farthest_m: float
    targets: list[DepthTarget]
    dropped: list[str]


class DepthScaleFile(DepthScale):
    """A depth scale file."""

    schema: Literal["calib.depth_scale/1"]


class Model(TypedDict):
    """The model of a result."""

    path: str
    name: str
    modality: Literal["rgb", "depth", "both"]
    precision: str
    provider: str


class Run(TypedDict):
    """`edgetree run --json`."""

    schema: Literal["edgetree.run/1"]
    source: str
    sources: NotRequired[list[str]]
    model: Model
    score_threshold: Share
    frames: list[Frame]
    pictures: str | None
    jsonl: str | None
    csv: str | None
    profiles: str | None
    coco: str | None
    report: str | None
    map: NotRequired[str]
    left_out: NotRequired[list[str]]
    incomplete: NotRequired[list[str]]
    interrupted: NotRequired[bool]


class Measure(TypedDict):
    """`edgetree measure --json`."""

    schema: Literal["edgetree.measure/1"]
    mask: NotRequired[str]
    model: NotRequired[Model]
    depth: str | None
    camera: Camera | None
    frame: Frame
    picture: str | None
    csv: str | None
    profiles: str | None


class Merge(TypedDict):
    """`edgetree merge --json`."""

    schema: Literal["edgetree.merge/1"]
    frames: Count
    trees: Count
    jsonl: str | None
    csv: str | None
    profiles: str | None
    left_out: list[str]


class KnownModel(TypedDict):
    """A model that is found by its name."""

    name: str
    path: str
    modality: Literal["rgb", "depth", "both"]
    precision: str
    size_bytes: Count
    input_px: Sides
    training_data: str
    card: dict[str, Any] | None


class Models(TypedDict):
    """`edgetree models --json`."""

    schema: Literal["edgetree.models/1"]
    models: list[KnownModel]


class MeasuredStem(TypedDict):
    """A stem of the machine's table."""

    frame: str
    tree: Count


class CaliperStem(TypedDict):
    """A stem of the caliper's table."""

    line: Count
    frame: str | None
    tree: Count | None


class Ambiguous(TypedDict):
    """Stems that fit each other, and others as well."""

    caliper: CaliperStem
    measured: MeasuredStem


class NotMeasured(MeasuredStem):
    """A stem of which the machine gives no value."""

    reason: str


class ShareOf(TypedDict):
    """A share with its 95 % interval."""

    count: Count
    total: Count
    value: Share | None
    low95: Share
    high95: Share


class Outlier(MeasuredStem):
    """A stem that is off by more than its error allows."""

    line: Count
    measured_m: float
    caliper_m: float
    error_m: float
    error_std_m: float


class LeftOut(Outlier):
    """A reading that looks wrong."""

    cause: str
    mistyped: bool


class Compared(TypedDict):
    """The comparison of one quantity."""

    stems: Count
    not_measured: list[NotMeasured]
    mean_m: float
    bias_m: float
    bias_std_m: float | None
    rmse_m: float
    rmse_share: float | None
    median_abs_error_m: float
    coverage: ShareOf
    mean_squared_standardised_error: float
    outliers: list[Outlier]
    left_out: list[LeftOut]


class Fit(TypedDict):
    """The fit of the stated errors."""

    scale: float
    scale_std: float
    scale_significant: bool
    factor: float
    factor_std: float
    factor_significant: bool
    coverage_before: ShareOf
    coverage_after: ShareOf
    settings: dict[str, float]


class CheckSettings(TypedDict):
    """`settings.json` of `edgetree check --out`: the fit, or why there is none."""

    schema: Literal["edgetree.check_settings/1"]
    settings: dict[str, float]
    reason: NotRequired[str]
    scale: NotRequired[float]
    scale_std: NotRequired[float]
    scale_significant: NotRequired[bool]
    factor: NotRequired[float]
    factor_std: NotRequired[float]
    factor_significant: NotRequired[bool]
    coverage_before: NotRequired[ShareOf]
    coverage_after: NotRequired[ShareOf]


class Missed(TypedDict):
    """Stems of the caliper that the machine did not find."""

    count: Count
    total: Count


class Check(TypedDict):
    """`edgetree check --json`."""

    schema: Literal["edgetree.check/1"]
    measured: str
    caliper: str
    matched_by: str
    matched: Count
    ambiguous: list[Ambiguous]
    caliper_only: list[CaliperStem]
    measured_only: list[MeasuredStem]
    max_distance_m: float | None
    quantities: dict[str, Compared]
    not_compared: dict[str, str]
    fit: Fit | None
    fit_failure: str | None
    passed: bool
    outcome: Literal["passed", "failed", "undecided"]
    reasons: list[str]
    missed: Missed
    power: dict[str, dict[str, float | int | None]]
    files: list[str]
