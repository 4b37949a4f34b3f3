"""Merge the parts of frames: row for row the results of one machine."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, TextIO

from basetree.errors import InputError
from basetree.files.json import build, parse_json
from basetree.files.writing import text_file
from basetree.jobs import JobError, MergedParts
from edgetree.results.csv_table import PROFILES, TREES
from edgetree.results.json_records import write_json_line

_TABLES: Final = {"csv": TREES, "profiles": PROFILES}


@dataclass(frozen=True)
class Outputs:
    """Files of merged results; None for those that are not wanted.

    Attributes:
        jsonl: The JSON lines.
        csv: The table of trees.
        profiles: The table of diameters along stems.
    """

    jsonl: Path | None = None
    csv: Path | None = None
    profiles: Path | None = None


@dataclass
class MergedFrames:
    """What was merged.

    Attributes:
        frames: Number of frames with a result.
        trees: Number of their trees.
        left_out: What was wrong with each frame without a result.
    """

    frames: int = 0
    trees: int = 0
    left_out: list[str] = field(default_factory=list)


def merge_frames(parts: MergedParts, outputs: Outputs, lines_to_stdout: bool) -> MergedFrames:
    """Write the results of all parts in the order of the frames, one part in memory at a time.

    Args:
        parts: The shards.
        outputs: Files to write.
        lines_to_stdout: Whether to print the JSON lines, if no file for them is given.

    Raises:
        InputError: a file cannot be written.
        InputError: a part cannot be read, or is none.
    """
    merged = MergedFrames()
    with ExitStack() as stack:
        opened: dict[str, TextIO] = {
            name: stack.enter_context(text_file(path))
            for name, path in vars(outputs).items()
            if path is not None
        }
        if lines_to_stdout and "jsonl" not in opened:
            opened["jsonl"] = sys.stdout
        for name, table in _TABLES.items():
            if name in opened:
                table.write_header(opened[name])
        for unit, content in enumerate(parts):
            _add(merged, _read(content, parts.job.part(unit)), opened)
    return merged


@dataclass(frozen=True)
class _Frame:
    """What is counted of a frame's record."""

    trees: tuple[Any, ...]


@dataclass(frozen=True)
class _Part:
    """The content of a part."""

    frames: tuple[dict[str, Any], ...]
    csv: str
    profiles: str
    left_out: tuple[str, ...]


def _read(content: bytes, name: str) -> tuple[_Part, int]:
    """A part, and the number of trees in it."""
    try:
        record = parse_json(content.decode())
        if not isinstance(record, dict) or record.get("schema") != "edgetree.part/1":
            raise ValueError("it has another schema")
        part = build(_Part, record, name)
        trees = sum(len(build(_Frame, frame, name).trees) for frame in part.frames)
    except (ValueError, InputError) as error:
        raise JobError(
            f"part {name} is not of schema edgetree.part/1 ({error}): expected shards of this"
            " version"
        ) from error
    return part, trees


def _add(merged: MergedFrames, found: tuple[_Part, int], opened: dict[str, TextIO]) -> None:
    part, trees = found
    merged.frames += len(part.frames)
    merged.trees += trees
    if "jsonl" in opened:
        for record in part.frames:
            write_json_line(opened["jsonl"], record)
    for name in _TABLES:
        if name in opened:
            opened[name].write(getattr(part, name))
    merged.left_out += part.left_out
