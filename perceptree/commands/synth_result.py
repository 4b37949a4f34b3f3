"""What `perceptree synth` and `merge` print of a finished dataset."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from basetree.counts import counted
from basetree.program.console import print_found
from basetree.program.quoting import quoted

if TYPE_CHECKING:
    from perceptree.simulator import SynthReport


def print_result(report: SynthReport, as_json: bool, frozen: str | None = None) -> None:
    """Print what is in a dataset, where it is, and what to do next.

    Args:
        report: The dataset.
        as_json: Whether to print one JSON object.
        frozen: Frozen preset to compare with.
    """
    from perceptree.simulator.dataset.contact_sheet import DEPTH_SHEET_FILE, SHEET_FILE
    from perceptree.simulator.dataset.pages import PAGE_FILE

    values: dict[str, Any] = {
        "schema": "perceptree.synth/1",
        **dataclasses.asdict(report),
        "directory": str(report.directory),
    }
    lines = [
        f"{split}: {counted(count, 'frame')}, {counted(report.trees[split], 'tree')}"
        for split, count in report.frames.items()
        if count
    ]
    lines += [
        f"frames by {group}: "
        + ", ".join(f"{name.replace('_', ' ')} {n}" for name, n in counts.items())
        for group, counts in report.conditions.items()
    ]
    lines += [
        f"{report.directory}",
        f"see {report.directory}/{SHEET_FILE}, {DEPTH_SHEET_FILE} in the same folder,"
        f" and the statistics in {report.directory}/{PAGE_FILE}",
    ]
    fails = False
    if isinstance(report.directory, str):
        lines.append(f"next: perceptree eval CHECKPOINT {quoted(report.directory)} --shards FOLDER")
    elif frozen is not None:
        values["frozen"], messages, fails = _compare(report.directory, frozen)
        lines += messages
    elif report.frames.get("train"):
        lines.append(
            f"next: perceptree train {quoted(report.directory)} --out runs/depth --modality depth"
        )
    else:
        lines.append(f"next: edgetree eval depth {quoted(report.directory)}")
    print_found(as_json, lambda: values, lambda: lines)
    if fails:
        raise typer.Exit(1)


def _compare(directory: Path, preset: str) -> tuple[dict[str, Any], list[str], bool]:
    """Compare with the frozen test set; return values, lines, and whether the labels differ."""
    from perceptree.simulator.dataset.frozen import (
        compare_with_frozen,
        library_versions,
        read_frozen,
    )

    frozen = read_frozen(preset)
    comparison = compare_with_frozen(directory, frozen)
    values = dataclasses.asdict(comparison)
    if not comparison.differing:
        return values, [f"all {comparison.files} files are equal to the frozen test set"], False
    made, here = (
        ", ".join(f"{name} {version}" for name, version in versions.items())
        for versions in (frozen.versions, library_versions())
    )
    lines = [
        f"{comparison.differing} of {comparison.files} files differ from the frozen test set: other"
        f" library versions or processors may flip single bytes (made with {made}; here {here})"
    ]
    if comparison.complaints:
        lines.append(f"its labels differ: {'; '.join(comparison.complaints)}")
    else:
        lines.append("its labels are the same within 1 %")
    return values, lines, bool(comparison.complaints)
