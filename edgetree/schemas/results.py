"""Types of the records of frames and of stems that are followed. Units are in the names."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Final, Literal, NotRequired, TypedDict

from msgspec import UNSET, Meta, UnsetType, defstruct

from basetree.schemas import Count, Share, Triple
from calib.schemas import RunLengths
from edgetree.measure.estimates import QUANTITIES, interval_keys
from edgetree.results.json_records import TRACK_QUANTITIES

Box = Annotated[list[float], Meta(min_length=4, max_length=4, description="x0, y0, x1, y1 in px")]


def intervals(quantities: Iterable[str]) -> list[tuple[str, Any, Any]]:
    """The keys of each quantity: a value with its deviation and interval, or a failure."""
    return [
        (key, str | UnsetType if key.endswith("_failure") else float | UnsetType, UNSET)
        for quantity in quantities
        for key in interval_keys(quantity)
    ]


class Profile(TypedDict):
    """Diameters along a stem."""

    heights_from: str
    height_m: list[float]
    diameter_m: list[float]
    diameter_std_m: list[float]


class Evidence(TypedDict):
    """What the values of a tree are based on."""

    method: str
    distance_from: str
    source_diameters_m: dict[str, float]
    source_std_m: dict[str, float]
    arc_deg: float
    valid_depth_share: Share
    visible_share: Share | None
    ground: str
    distance_at: str
    warnings: list[str]


METRES_FIELDS: Final[list[tuple[str, Any, Any]]] = [
    *intervals(QUANTITIES),
    ("species", str | None, None),
    ("profile", Profile | UnsetType, UNSET),
    ("profile_failure", str | UnsetType, UNSET),
    *(
        (f"{point}{what}", kind | UnsetType, UNSET)
        for point in ("cut_point", "cut_point_machine")
        for what, kind in (("_m", Triple), ("_std_m", Triple), ("_failure", str))
    ),
]
Metres = defstruct("Metres", [*METRES_FIELDS, ("evidence", Evidence)], kw_only=True)
"""The measurement of a tree; a value that is missing has a reason."""


class Pixels(TypedDict):
    """The size of a tree in the picture, or why there is none."""

    width_px: NotRequired[float]
    width_std_px: NotRequired[float]
    width_deg: NotRequired[float | None]
    width_std_deg: NotRequired[float | None]
    width_at: NotRequired[str]
    lean_in_picture_deg: NotRequired[float]
    lean_in_picture_std_deg: NotRequired[float]
    width_failure: NotRequired[str]


class Tree(TypedDict):
    """A tree of a frame; `track` in videos and recordings, null until the stem is followed."""

    tree: Count
    track: NotRequired[Count | None]
    score: Share
    box_px: Box
    keypoints_px: NotRequired[dict[str, Triple]]
    mask_rle: NotRequired[RunLengths]
    pixels: Pixels
    metres: Metres | None  # type: ignore[valid-type]
    metres_need: NotRequired[str | None]


class Alone(TypedDict):
    """Which image a model of colour and depth used alone, and why."""

    image: Literal["colour", "depth", "neither"]
    reason: str


class Unlike(TypedDict):
    """How an image differs from those of the training."""

    statistic: str
    value: float
    usual: Annotated[list[float], Meta(min_length=2, max_length=2)]
    unit: str
    advice: str


class Frame(TypedDict):
    """A line of `edgetree run`."""

    schema: Literal["edgetree.frame/1"]
    frame: str
    path: str
    image_width_px: Count
    image_height_px: Count
    detect_ms: float
    trees: list[Tree]
    time_s: NotRequired[float]
    unlike_training: NotRequired[Unlike]
    alone: NotRequired[Alone]


class LiveTree(TypedDict):
    """A tree in view."""

    tree: Count
    track: Count | None
    score: Share
    box_px: Box
    metres: Metres | None  # type: ignore[valid-type]


Track = defstruct(
    "Track",
    [
        ("track", Count),
        ("state", str),
        ("tree", Count | None),
        ("position_m", Triple),
        ("position_std_m", Triple),
        ("position_camera_m", Triple),
        *intervals(TRACK_QUANTITIES),
        ("frames", Count),
        ("views", Count),
        ("arc_deg", float),
        ("more_views_help", bool),
        ("last_seen_s", float),
        ("map_part", Count),
        ("absorbed", list[Count]),
        ("warnings", list[str]),
    ],
    kw_only=True,
)
"""A stem that is followed."""


class Live(TypedDict):
    """A line of `edgetree live`."""

    schema: Literal["edgetree.live/1"]
    frame: Count
    time_s: float
    image_width_px: Count
    image_height_px: Count
    age_s: float
    dropped: Count
    stages_ms: dict[str, float]
    trees: list[LiveTree]
    tracks: list[Track]  # type: ignore[valid-type]
    metres_need: NotRequired[str]
    alone: NotRequired[Alone]


class ShortStem(TypedDict):
    """What a controller needs of a stem; null for what was not measured."""

    track: Count
    state: str
    in_view: bool
    position_camera_m: Triple
    diameter_m: float | None
    diameter_std_m: float | None
    cut_height_m: float | None
    cut_height_std_m: float | None
    last_seen_s: float


class Stems(TypedDict):
    """A message of `edgetree live --udp` and `--mqtt`."""

    schema: Literal["edgetree.live.stems/1"]
    frame: Count
    time_s: float
    age_s: float
    left_out: Count
    sequence: NotRequired[Count]
    stems: list[ShortStem]


class Point(TypedDict):
    """A point of GeoJSON."""

    type: Literal["Point"]
    coordinates: Triple


class Feature(TypedDict):
    """A stem of a map."""

    type: Literal["Feature"]
    id: Count
    geometry: Point
    properties: dict[str, float | int | str | None]


class StemMap(TypedDict):
    """The GeoJSON of `--map`."""

    type: Literal["FeatureCollection"]
    schema: Literal["edgetree.live.map/1"]
    coordinates: Literal["local metres", "WGS 84"]
    features: list[Feature]
