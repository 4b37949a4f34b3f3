"""Types of the stems that the page of `edgetree live` shows. Units are in the names."""

from __future__ import annotations

from typing import Annotated, Literal, NotRequired, TypedDict

from msgspec import Meta, defstruct

from basetree.schemas import Count
from edgetree.live.page.records import QUANTITIES
from edgetree.live.recording.recorder import RecorderStatus
from edgetree.schemas.results import intervals

Pair = Annotated[list[float], Meta(min_length=2, max_length=2)]

Stem = defstruct(
    "Stem",
    [
        ("number", Count),
        ("colour", str),
        ("state", str),
        ("in_view", bool),
        ("unseen_s", float),
        ("plan_m", Pair),
        ("plan_std_m", float),
        ("distance_m", float),
        *intervals(QUANTITIES),
        ("frames", Count),
        ("views", Count),
        ("arc_deg", float),
        ("more_views_help", bool),
        ("warnings", list[str]),
    ],
    kw_only=True,
)
"""A stem that is followed; `plan_m` is metres to the right of the camera and ahead of it."""


class Page(TypedDict):
    """The event `stems` of the page, and `/stems.json`, which adds the state of the feed."""

    schema: Literal["edgetree.live.page/1"]
    frame: Count
    time_s: float
    age_s: float
    dropped: Count
    stages_ms: dict[str, float]
    field_of_view_deg: Pair | None
    trees: Count
    metres_need: str | None
    stems: list[Stem]  # type: ignore[valid-type]
    serial: NotRequired[Count]
    rate_hz: NotRequired[float | None]
    state: NotRequired[Literal["waiting", "stale", "live"]]
    clock_s: NotRequired[float]
    taken_s: NotRequired[float | None]
    stale_s: NotRequired[float]
    recordings: NotRequired[RecorderStatus | None]
