"""Results as CSV tables of trees, of diameters along stems, and of stems that are followed.

Units are in the names of the columns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Generic, TextIO, TypeVar

from edgetree.frames.pipeline import FrameResult
from edgetree.measure import (
    QUANTITIES,
    Estimate,
    Failure,
    PixelSize,
    StemProfile,
    TreeMeasurement,
)
from edgetree.measure.estimates import interval_keys
from edgetree.results.csv_style import PLAIN, CsvStyle
from edgetree.results.json_records import TRACK_QUANTITIES, track_record

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult

_Result = TypeVar("_Result", bound=FrameResult)


@dataclass(frozen=True)
class Table(Generic[_Result]):
    """A CSV table of results.

    Attributes:
        columns: Names of the columns.
        rows: Makes the rows of a result, values by column. Cells without a value are empty.
        short: The columns of the table for people; all if empty.
    """

    columns: tuple[str, ...]
    rows: Callable[[_Result], Iterable[Mapping[str, object]]]
    short: tuple[str, ...] = ()

    def write_header(self, stream: TextIO, style: CsvStyle = PLAIN) -> None:
        """Write the column names. The stream must have been opened with `newline=""`."""
        style.write_header(stream, self.columns, self.short)

    def write_rows(self, stream: TextIO, result: _Result, style: CsvStyle = PLAIN) -> None:
        """Write the rows of a result."""
        style.write_rows(stream, self.columns, self.short, self.rows(result))
        stream.flush()


def measurements_of(result: FrameResult) -> list[TreeMeasurement]:
    """The measurement of each tree; failures that name the missing options if there is none."""
    if result.measurements is not None:
        return result.measurements
    return [TreeMeasurement.failed(f"metres {result.metres_need}")] * len(result.trees)


def _coordinates(name: str) -> tuple[str, ...]:
    return tuple(f"{name}_{axis}_m" for axis in "xyz")


def _of_quantities(quantities: Iterable[str]) -> tuple[str, ...]:
    return tuple(key for quantity in quantities for key in interval_keys(quantity))


_BOX: Final = ("box_x0_px", "box_y0_px", "box_x1_px", "box_y1_px")
_CUT_POINTS: Final = {"cut_point": "cut_point_camera", "cut_point_machine": "cut_point_machine"}
_PIXELS: Final = (
    "width_px",
    "width_std_px",
    "width_deg",
    "width_std_deg",
    "width_at",
    "lean_in_picture_deg",
    "lean_in_picture_std_deg",
)
_EVIDENCE: Final = (
    "method",
    "distance_from",
    "arc_deg",
    "valid_depth_share",
    "visible_share",
    "ground",
    "warnings",
)
_SHORT_QUANTITIES: Final = (
    "diameter_m",
    "dbh_m",
    "cut_height_m",
    "distance_m",
    "inclination_deg",
    "volume_m3",
)
_PROFILE: Final = (
    "profile_heights_from",
    "profile_lowest_m",
    "profile_highest_m",
    "profile_failure",
)


def _tree_rows(result: FrameResult) -> Iterator[dict[str, Any]]:
    trees, measurements, sizes = result.trees, measurements_of(result), result.pixel_sizes
    tracks = result.found.tracks
    for index, number in enumerate(result.found.numbers):
        yield {
            "frame": result.frame.name,
            "tree": number,
            "track": None if tracks is None else tracks[index],
            "score": float(trees.scores[index]),
            **dict(zip(_BOX, trees.boxes_px[index].tolist(), strict=True)),
            **_pixels(sizes[index]),
            **_metres(measurements[index].to_dict()),
        }


def _pixels(size: PixelSize | Failure) -> dict[str, Any]:
    return size.to_dict() if isinstance(size, PixelSize) else {}


def _metres(values: Mapping[str, Any]) -> dict[str, Any]:
    """The entries of `TreeMeasurement.to_dict` by column name."""
    row = {name: value for name, value in values.items() if name in TREES.columns}
    for name, column in _CUT_POINTS.items():
        row |= zip(_coordinates(column), values.get(f"{name}_m", ()), strict=False)
        row[f"{column}_failure"] = values.get(f"{name}_failure")
    if "profile" in values:
        profile = values["profile"]
        ends = (profile["height_m"][0], profile["height_m"][-1])
        row |= zip(_PROFILE, (profile["heights_from"], *ends), strict=False)
    evidence = values["evidence"]
    return {**row, **{name: evidence[name] for name in _EVIDENCE}}


TREES: Final = Table(
    (
        "frame",
        "tree",
        "track",
        "score",
        *_BOX,
        *_PIXELS,
        *_of_quantities(QUANTITIES),
        "species",
        *_PROFILE,
        *(
            column
            for name in _CUT_POINTS.values()
            for column in (*_coordinates(name), f"{name}_failure")
        ),
        *_EVIDENCE,
    ),
    _tree_rows,
    (
        "frame",
        "tree",
        *(column for quantity in _SHORT_QUANTITIES for column in interval_keys(quantity)[:2]),
        "species",
        "diameter_failure",
        "dbh_failure",
        "cut_height_failure",
        "warnings",
        *(column for name in _CUT_POINTS.values() for column in _coordinates(name)),
    ),
)
"""A row for each tree; where a value is missing, `<quantity>_failure` gives the reason."""


def _profile_rows(result: FrameResult) -> Iterator[dict[str, Any]]:
    for number, tree in zip(result.found.numbers, measurements_of(result), strict=True):
        if not isinstance(tree.profile, StemProfile):
            continue
        profile = tree.profile
        arrays = (profile.height_m, profile.diameter_m, profile.diameter_std_m)
        for height_m, *diameter in zip(*(array.tolist() for array in arrays), strict=True):
            estimate = Estimate(*diameter)
            values = (result.frame.name, number, profile.heights_from, height_m)
            row = (*values, *estimate, *estimate.interval95)
            yield dict(zip(PROFILES.columns, row, strict=True))


PROFILES: Final = Table(
    ("frame", "tree", "heights_from", "height_m", *interval_keys("diameter_m")[:-1]),
    _profile_rows,
)
"""A row for each tree and height; trees without a profile have none."""

_POINTS: Final = ("position_m", "position_std_m", "position_camera_m")


def _track_rows(result: LiveResult) -> Iterator[dict[str, Any]]:
    at = {"frame": result.frame.number, "time_s": result.frame.time_s}
    for tree, number in enumerate(result.found.tracks or ()):
        if number is not None:
            yield {**at, "track": number, "state": "confirmed", "tree": tree + 1}
    for track in result.tracks:
        row = {**at, **track_record(track)}
        for key in _POINTS:
            row |= zip(_coordinates(key.removesuffix("_m")), row.pop(key), strict=True)
        yield row


TRACKS: Final = Table(
    (
        "frame",
        "time_s",
        "track",
        "state",
        "tree",
        *(column for key in _POINTS for column in _coordinates(key.removesuffix("_m"))),
        *_of_quantities(TRACK_QUANTITIES),
        "frames",
        "views",
        "arc_deg",
        "more_views_help",
        "last_seen_s",
        "map_part",
        "absorbed",
        "warnings",
    ),
    _track_rows,
    (
        "frame",
        "time_s",
        "track",
        "state",
        *_coordinates("position"),
        *(column for name in TRACK_QUANTITIES for column in interval_keys(name)[:2]),
        "diameter_failure",
        "dbh_failure",
        "frames",
        "warnings",
    ),
)
"""A row for each frame and stem that is followed, seen in the frame or not."""
