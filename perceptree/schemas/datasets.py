"""Types of what `perceptree synth` and `perceptree data` write. Units are in the names."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NotRequired, TypedDict

from msgspec import Meta

from basetree.schemas import Count, Sha256, Share, Side, Triple
from basetree.settings import json_schema
from calib.schemas import Box, Camera, CocoCategory, RunLengths
from perceptree.simulator.settings import SimulatorSettings
from perceptree.simulator.settings.files import FileSettings


def _settings(kind: type) -> Any:
    """The type of settings as they are written: those at their default may be left out."""
    made = _open({key: value for key, value in json_schema(kind).items() if key != "$schema"})
    return Annotated[dict[str, Any], Meta(extra_json_schema=made)]


def _open(schema: Any) -> Any:
    """A schema that allows keys that it does not name."""
    if not isinstance(schema, dict):
        return schema
    kept = {k: v for k, v in schema.items() if (k, v) != ("additionalProperties", False)}
    return {key: _open(value) for key, value in kept.items()}


class WorldPose(TypedDict):
    """Where the camera of a drive is in the world."""

    origin_m: Triple
    rotation: Annotated[list[Triple], Meta(min_length=3, max_length=3)]


class Image(TypedDict):
    """A picture. Those of a simulated frame have all keys up to `pose`."""

    id: int
    file_name: str
    width: Side
    height: Side
    depth_file: NotRequired[str]
    depth8_file: NotRequired[str]
    depth_exact_file: NotRequired[str]
    depth_exact_stride_px: NotRequired[Side]
    depth_encoding: NotRequired[dict[str, float]]
    depth_sensor: NotRequired[dict[str, Any]]
    camera: NotRequired[Camera]
    up_camera: NotRequired[Triple | None]
    scene: NotRequired[dict[str, Any]]
    pose: NotRequired[dict[str, Any]]
    realism: NotRequired[dict[str, Any]]
    time_s: NotRequired[float]
    pose_world: NotRequired[WorldPose]
    imu_file: NotRequired[str]


class TreeOfFrame(TypedDict):
    """A tree. Keypoints are pixel indices and COCO's flag, three numbers for each of five."""

    image_id: int
    category_id: int
    bbox: Box
    area: float
    iscrowd: int
    segmentation: NotRequired[RunLengths | list[list[float]]]
    keypoints: list[float]
    num_keypoints: Count
    distance_m: NotRequired[float]
    diameter_m: NotRequired[float]
    diameter_height_m: NotRequired[float]
    diameter_breast_m: NotRequired[float]
    cut_height_m: NotRequired[float]
    inclination_deg: NotRequired[float]
    position_m: NotRequired[Triple]
    position_world_m: NotRequired[Triple]
    visible_fraction: NotRequired[Share]
    species: NotRequired[str]
    model: NotRequired[str]
    stem: NotRequired[Count]
    ignore: NotRequired[int]


class NumberedTree(TreeOfFrame):
    """A tree with its number in the file."""

    id: int


class Labels(TypedDict):
    """`SPLIT_RGB.json` of `synth` and of `data split`, `merge` and `convert`; no key `schema`."""

    info: NotRequired[dict[str, str]]
    images: list[Image]
    annotations: list[NumberedTree]
    categories: list[CocoCategory]


class SceneFrame(TypedDict):
    """A frame of a scene, with the size of each of its files."""

    image: Image
    annotations: list[TreeOfFrame]
    bytes: dict[str, Count]
    depth_valid_share: Share


SceneFrames = Annotated[
    list[SceneFrame],
    Meta(description="`scenes/NUMBER.json` of a dataset: the frames of a scene, without a key."),
]


class SynthSettings(TypedDict):
    """`settings.json` of a dataset: what decides its content; no key `schema`."""

    settings: _settings(SimulatorSettings)  # type: ignore[valid-type]
    seed: Count
    files: _settings(FileSettings)  # type: ignore[valid-type]
    version: int
    sha256: Sha256
    textures: NotRequired[list[dict[str, Any]]]


class DataSettings(TypedDict):
    """`settings.json` of `data split`, `merge` and `convert`: what the sources' states."""

    textures: NotRequired[list[dict[str, Any]]]
    reach_m: NotRequired[float]


class SplitFigures(TypedDict):
    """Numbers of a split."""

    scenes: Count
    frames: Count
    trees: Count
    trees_per_frame: float


class PerFrame(TypedDict):
    """Trees in a frame: the mean, and the number of frames with 0, 1, 2 and so on."""

    mean: float
    counts: list[int]


class Histogram(TypedDict):
    """Counts between edges, outliers in the outermost; quantiles where there is a value."""

    edges: list[float]
    counts: list[int]
    mean: NotRequired[float]
    p5: NotRequired[float]
    median: NotRequired[float]
    p95: NotRequired[float]


class Flags(TypedDict):
    """Trees whose keypoint is outside of the frame, hidden or visible."""

    outside: Count
    hidden: Count
    visible: Count


class Bytes(TypedDict):
    """Bytes of a frame."""

    folders: dict[str, Count]
    mean: Count
    largest: Count


class Statistics(TypedDict):
    """`statistics.json` of a dataset; numbers are of frames or trees."""

    schema: Literal["perceptree.statistics/1"]
    splits: dict[str, SplitFigures]
    trees_per_frame: PerFrame
    tree: dict[str, Histogram]
    keypoints: dict[str, Flags]
    species: dict[str, int]
    models: dict[str, int]
    weather_by_light: dict[str, dict[str, int]]
    terrain: dict[str, int]
    slope_deg: Histogram
    stems_per_ha: Histogram
    carrier: dict[str, int]
    depth_sensor: dict[str, int]
    depth_valid_share: dict[str, Share]
    bytes_per_frame: Bytes
    realism: dict[str, int]


class FrozenComparison(TypedDict):
    """The comparison with a frozen test set."""

    files: Count
    differing: Count
    complaints: list[str]


class Synth(TypedDict):
    """`perceptree synth --json`, and `perceptree merge --json` of a dataset."""

    schema: Literal["perceptree.synth/1"]
    directory: str
    frames: dict[str, int]
    trees: dict[str, int]
    conditions: dict[str, dict[str, int]]
    frozen: NotRequired[FrozenComparison]


class FrozenSet(TypedDict):
    """What a frozen test set must be; in the package, no key `schema`."""

    name: str
    seed: Count
    frames: Count
    settings_sha256: Sha256
    content_sha256: Sha256
    trees_per_frame: float
    occlusion: list[Share]
    files: dict[str, str]
    versions: dict[str, str]


class CheckedSplit(TypedDict):
    """A split, and what its labels hold."""

    split: str
    labels: str
    frames: Count
    trees: Count
    has_masks: bool
    has_keypoints: bool
    has_depth: bool
    notes: list[str]


class Finding(TypedDict):
    """A kind of problem, how often it is there, and where first."""

    kind: str
    text: str
    count: Count
    first: list[str]


class DataCheck(TypedDict):
    """`perceptree data check --json`."""

    schema: Literal["perceptree.data-check/1"]
    splits: list[CheckedSplit]
    findings: list[Finding]
    compared_by: str


class Quantiles(TypedDict):
    """Three quantiles."""

    p5: float
    median: float
    p95: float


class Likeness(TypedDict):
    """How a measure of real pictures differs from that of simulated ones."""

    real: Quantiles
    simulated: Quantiles
    separation: float
    shift: float


class DataCompare(TypedDict):
    """`perceptree data compare --json`."""

    schema: Literal["perceptree.data-compare/1"]
    real: Count
    simulated: Count
    measures: dict[str, Likeness]
    page: str


class WrittenSplit(TypedDict):
    """What a split holds."""

    pictures: Count
    trees: Count


class DataWritten(TypedDict):
    """`perceptree data split`, `merge` and `convert` with `--json`."""

    schema: Literal["perceptree.data-written/1"]
    out: str
    form: str
    splits: dict[str, WrittenSplit]
