"""What a dataset's `settings.json` states of its frames: reach of the labels, photographs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from basetree.files.regular import read_regular
from basetree.files.writing import write_text
from perceptree.simulator.dataset.storage import SETTINGS_FILE
from perceptree.simulator.photographs.folder import CREDITS, dataset_credits

_REACH = "reach_m"


def labelled_reach_m(folders: Iterable[Path]) -> float | None:
    """The distance up to which trees are labelled in all of these datasets, m.

    Returns:
        What the datasets' `settings.json` state; None if one states nothing, or they differ.
    """
    found = {_stated_reach_m(folder / SETTINGS_FILE) for folder in folders}
    return found.pop() if len(found) == 1 else None


def _stated_reach_m(settings_file: Path) -> float | None:
    """The reach in a file of the simulator, or of datasets made of others."""
    try:
        content = json.loads(read_regular(settings_file))
        stated = content.get(_REACH) or content["settings"]["labels"][_REACH]
    except (OSError, ValueError, RecursionError, AttributeError, KeyError, TypeError):
        return None
    is_number = isinstance(stated, int | float) and not isinstance(stated, bool)
    return float(stated) if is_number and 0 < stated <= sys.float_info.max else None


def folder_credits(folders: Iterable[Path]) -> list[dict[str, Any]]:
    """The photographs in the frames of these datasets, each once, with their licences.

    Raises:
        DatasetError: If a dataset's `settings.json` cannot be read.
    """
    paths = [path for folder in folders if (path := folder / SETTINGS_FILE).is_file()]
    found: list[dict[str, Any]] = []
    for path in paths:
        found += [each for each in dataset_credits(path) if each not in found]
    return found


def stated(folders: Iterable[Path]) -> dict[str, Any]:
    """What the `settings.json` of a dataset made of others states; empty if nothing is known.

    Raises:
        DatasetError: As `folder_credits`.
    """
    sources = list(folders)
    owed, reach_m = folder_credits(sources), labelled_reach_m(sources)
    return ({CREDITS: owed} if owed else {}) | ({} if reach_m is None else {_REACH: reach_m})


def write_stated(out: Path, content: dict[str, Any]) -> None:
    """Write the `settings.json` of a dataset made of others, if anything is known.

    Raises:
        UnwritableFile: If it cannot be written.
    """
    if content:
        write_text(out / SETTINGS_FILE, json.dumps(content) + "\n")
