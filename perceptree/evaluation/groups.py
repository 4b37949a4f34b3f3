"""Groups of trees or frames by labelled conditions, such as distance or weather."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from perceptree.data import FrameRecord, TreeRecord

_INFINITY = float("inf")


@dataclass(frozen=True)
class Axis:
    """A condition by which trees or frames are grouped: a numeric range or a name.

    Attributes:
        name: Key in JSON.
        title: Title for people.
        value: Returns the condition of a tree, or of a frame if the tree is None.
        edges: Limits of the ranges, lower limit included; empty for names.
        order: Order in which names are listed; others follow alphabetically.
        unit: Unit shown in range names.
        per_unit: Factor from the value to the unit shown.
        of_frames: Whether the condition belongs to frames rather than trees.
    """

    name: str
    title: str
    value: Callable[[FrameRecord, TreeRecord | None], Any]
    edges: tuple[float, ...] = ()
    order: tuple[str, ...] = ()
    unit: str = ""
    per_unit: float = 1.0
    of_frames: bool = False


@dataclass(frozen=True)
class Group:
    """A group of trees.

    Attributes:
        name: Name or range.
        trees: Indices of the trees among all trees of all frames.
        frames: Indices of the frames in which they are searched for.
    """

    name: str
    trees: frozenset[int]
    frames: frozenset[int]


def _truth(name: str) -> Callable[[FrameRecord, TreeRecord | None], Any]:
    return lambda _, tree: None if tree is None else tree.truth.get(name)


def _scene(name: str) -> Callable[[FrameRecord, TreeRecord | None], Any]:
    def value(frame: FrameRecord, _: TreeRecord | None) -> Any:
        scene = frame.extra.get("scene")
        return scene.get(name) if isinstance(scene, dict) else None

    return value


DISTANCE = Axis(
    "distance_m", "Distance", _truth("distance_m"), (0, 2.5, 5, 7.5, 10, _INFINITY), unit="m"
)
AXES = (
    DISTANCE,
    Axis(
        "visible_fraction",
        "Visible part of the lower trunk",
        _truth("visible_fraction"),
        (0, 0.25, 0.5, 0.75, _INFINITY),
        unit="%",
        per_unit=100,
    ),
    Axis("species", "Species", lambda _, tree: None if tree is None else tree.species),
    Axis(
        "weather",
        "Weather",
        _scene("weather"),
        of_frames=True,
        order=("clear", "snow", "wet", "fog", "rain", "snowfall"),
    ),
    Axis(
        "light",
        "Light",
        _scene("light"),
        of_frames=True,
        order=("morning", "daylight", "evening", "dusk"),
    ),
    Axis(
        "slope_deg",
        "Slope of the ground",
        _scene("slope_deg"),
        (0, 10, 20, 30, _INFINITY),
        unit="°",
        of_frames=True,
    ),
)


def groups_of(frames: Sequence[FrameRecord], axis: Axis) -> list[Group]:
    """Group the trees by a condition.

    Returns:
        The groups that have a tree; empty if the labels do not give the condition. For conditions
        of trees, every group covers all frames.
    """
    trees: dict[str, set[int]] = {}
    own_frames: dict[str, set[int]] = {}
    tree_index = 0
    for number, frame in enumerate(frames):
        if axis.of_frames and (label := _label(axis, axis.value(frame, None))) is not None:
            own_frames.setdefault(label, set()).add(number)
        for tree in frame.trees:
            label = _label(axis, axis.value(frame, tree))
            if label is not None and not tree.ignored:
                trees.setdefault(label, set()).add(tree_index)
            tree_index += 1
    everywhere = range(len(frames))
    return [
        Group(name, frozenset(trees[name]), frozenset(own_frames.get(name, everywhere)))
        for name in _sorted_names(axis, trees)
    ]


def _sorted_names(axis: Axis, found: dict[str, set[int]]) -> list[str]:
    known = axis.order
    if axis.edges:
        known = tuple(_range_name(axis, low, high) for low, high in pairwise(axis.edges))
    return [name for name in known if name in found] + sorted(set(found) - set(known))


def _label(axis: Axis, value: Any) -> str | None:
    """Return the name of the group of a value; None if the value is not usable."""
    if not axis.edges:
        return value if isinstance(value, str) and value else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    for low, high in pairwise(axis.edges):
        if low <= value < high:
            return _range_name(axis, low, high)
    return None


def _range_name(axis: Axis, low: float, high: float) -> str:
    first, last = (f"{axis.per_unit * edge:g}" for edge in (low, high))
    space = "" if axis.unit == "°" else " "
    if high == _INFINITY:
        return f"from {first}{space}{axis.unit}"
    return f"{first} to {last}{space}{axis.unit}"
