"""Measurements as a text table for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from textwrap import wrap
from typing import Final

from edgetree.measure import (
    Estimate,
    Evidence,
    Failure,
    PixelSize,
    StemProfile,
    TreeMeasurement,
)
from edgetree.measure.pixel_sizes import BREAST_HEIGHT
from edgetree.measure.volume import VOLUME_SOURCE
from edgetree.results.units import AMOUNTS, direction_words

_COLUMNS: Final = ("diameter_m", "dbh_m", "cut_height_m", "inclination_deg", "distance_m")
_LINE: Final = 100
_INDENT: Final = " " * 6
_GAP: Final = "  "
_MISSING: Final = "–"


def table_lines(
    measurements: list[TreeMeasurement],
    numbers: tuple[int, ...],
    sizes: Sequence[PixelSize | Failure] | None = None,
    *,
    width: int | None = None,
) -> Iterator[str]:
    """The lines of the table.

    Each tree has a row, followed by the values without a column, its failures, its warnings and
    the evidence.

    Args:
        measurements: The measurement of each tree.
        numbers: The number of each tree.
        sizes: The size of each tree in the picture, told where there is no diameter.
        width: Columns of the terminal. Where a row does not fit, its last columns become lines
            below it; None if there is no limit.
    """
    if not measurements:
        yield "no trees"
        return
    shown, below = _fitting(measurements, numbers, width)
    head, *rows = shown
    yield head
    for index, (row, tree) in enumerate(zip(rows, measurements, strict=True)):
        yield row
        notes = [*below[index], *further_values(tree)]
        notes += [f"{what}: {reason}" for what, reason in failure_reasons(tree)]
        notes += [f"warning: {text}" for text in tree.evidence.warnings]
        ground = tree.evidence.ground
        if ground and not any(ground in text for text in notes):
            notes.append(f"ground: {ground}")
        if tree.evidence.method:
            notes.append(_evidence(tree.evidence))
        if sizes is not None and not has_diameter(tree):
            notes.append(pixel_words(sizes[index]))
        for text in notes:
            yield from _wrapped(text, width, _INDENT)
    words = "± is one standard deviation; twice that holds the truth for 95 trees in 100"
    yield from _wrapped(words, width)


def _wrapped(text: str, width: int | None, indent: str = "") -> list[str]:
    return wrap(
        text,
        min(width or _LINE, _LINE),
        initial_indent=indent,
        subsequent_indent=f"{indent}  " if indent else "",
        break_long_words=False,
        break_on_hyphens=False,
    )


def _fitting(
    measurements: Sequence[TreeMeasurement], numbers: Sequence[int], width: int | None
) -> tuple[list[str], list[list[str]]]:
    """The head and the rows with as many columns as fit, and what stands below each row."""
    columns = [
        [AMOUNTS[name].name, *(_cell(tree, name) for tree in measurements)] for name in _COLUMNS
    ]
    below: list[list[str]] = [[] for _ in measurements]
    first = [["tree", *(f"{number:4}" for number in numbers)]]
    while len(columns) > 1:
        rows = _rows(first + columns)
        if width is None or max(map(len, rows)) <= width:
            break
        name, *cells = columns.pop()
        for notes, text in zip(below, cells, strict=True):
            if text != _MISSING:
                notes.insert(0, f"{name}: {text}")
    return _rows(first + columns), below


def _rows(columns: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in columns]
    return [
        _GAP.join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in zip(*columns, strict=True)
    ]


def _cell(tree: TreeMeasurement, quantity: str) -> str:
    result: Estimate | Failure = getattr(tree, quantity)
    if isinstance(result, Failure):
        return _MISSING
    text = AMOUNTS[quantity].with_std(result)
    if quantity == "inclination_deg":
        text = f"{text} {direction_words(result, tree.lean_direction_deg)}".rstrip()
    return text


def further_values(tree: TreeMeasurement) -> Iterator[str]:
    """The values that have no column, as lines of text."""
    if isinstance(tree.distance_m, Failure) and isinstance(tree.axis_distance_m, Estimate):
        yield f"distance to the axis: {AMOUNTS['axis_distance_m'].with_std(tree.axis_distance_m)}"
    profile = tree.profile
    if isinstance(profile, StemProfile):
        lowest, highest = profile.height_m[[0, -1]]
        what = {"ground": "above the ground", "section": "from the diameter's section"}
        parts = [
            f"{len(profile.height_m)} diameters from {lowest:.1f} to {highest:.1f} m"
            f" {what[profile.heights_from]}"
        ]
        if isinstance(tree.taper_cm_per_m, Estimate):
            parts.append(f"taper {AMOUNTS['taper_cm_per_m'].with_std(tree.taper_cm_per_m)}")
        if isinstance(tree.seen_volume_m3, Estimate):
            volume = AMOUNTS["seen_volume_m3"].with_std(tree.seen_volume_m3)
            parts.append(f"volume of this part {volume}")
        yield f"profile: {', '.join(parts)}"
    if isinstance(tree.volume_m3, Estimate):
        volume = AMOUNTS["volume_m3"].with_std(tree.volume_m3)
        yield f"volume of the whole stem: {volume} ({tree.species}, {VOLUME_SOURCE})"


def failure_reasons(tree: TreeMeasurement) -> Iterator[tuple[str, str]]:
    """The quantities that could not be measured, grouped by reason, such as ("no DBH", reason)."""
    missing: dict[str, list[str]] = {}
    # Without a species, nobody asked for the volume of whole stems.
    asked = {**AMOUNTS}
    if tree.species is None:
        del asked["volume_m3"]
    for quantity, amount in asked.items():
        result: Estimate | Failure = getattr(tree, quantity)
        if isinstance(result, Failure):
            missing.setdefault(result.reason, []).append(amount.name)
    for reason, names in missing.items():
        yield "not measured" if len(names) == len(asked) else f"no {', '.join(names)}", reason


def has_diameter(tree: TreeMeasurement) -> bool:
    """Whether a diameter was measured, at the cut or at breast height."""
    return any(isinstance(each, Estimate) for each in (tree.diameter_m, tree.dbh_m))


def pixel_words(size: PixelSize | Failure) -> str:
    """The size of a tree in the picture, as text."""
    if isinstance(size, Failure):
        return f"no width in the picture: {size.reason}"
    width, angle, lean = size.width_px, size.width_deg, size.lean_in_picture_deg
    place = size.width_at if size.width_at == BREAST_HEIGHT else f"the {size.width_at}"
    degrees = "" if angle is None else f", {angle.value:.2f} ± {angle.std:.2f}°"
    return (
        f"in the picture {width.value:.0f} ± {width.std:.0f} px wide at {place}"
        f"{degrees}, leaning by {lean.value:.1f} ± {lean.std:.1f}°"
    )


def _evidence(evidence: Evidence) -> str:
    shown = evidence.visible_share
    visible = "" if shown is None else f"{shown:.0%} of the stem visible, "
    if evidence.distance_from not in ("depth", ""):
        return f"from {evidence.method}; {visible}distance from {evidence.distance_from}"
    return (
        f"from {evidence.method}; {visible}depth at {evidence.valid_depth_share:.0%} of it,"
        f" an arc of {evidence.arc_deg:.0f}° seen"
    )
