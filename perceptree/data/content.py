"""Read JSON files, and tell label files by what they hold."""

from __future__ import annotations

import json
import mmap
from pathlib import Path
from typing import Any

from basetree.files.json import unique_keys
from basetree.files.regular import open_regular, read_regular
from perceptree.errors import DatasetError

_LISTS = ("images", "annotations", "categories")
_KEYPOINTS = "keypoints"


def load(path: Path) -> Any:
    """Read a JSON file in UTF-8, UTF-16 or UTF-32, with or without a byte order mark.

    Raises:
        DatasetError: If it cannot be read, is not JSON or gives a key of an object twice.
    """
    try:
        return json.loads(read_regular(path), object_pairs_hook=unique_keys)
    except (OSError, ValueError, RecursionError) as error:
        raise DatasetError(f"not readable JSON ({error}), expected a COCO file") from error


def is_coco(path: Path) -> bool:
    """Whether a file names the lists images, annotations and categories, as COCO does."""
    return holds(path, _LISTS)


def has_keypoints(path: Path) -> bool:
    """Whether a file names keypoints anywhere."""
    return holds(path, (_KEYPOINTS,))


def holds(path: Path, names: tuple[str, ...]) -> bool:
    """Whether all names stand in a file as JSON texts; takes no memory for a file in UTF-8."""
    texts = [f'"{name}"' for name in names]
    try:
        with (
            open_regular(path) as file,
            mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data,
        ):
            if b"\0" not in data[:8]:
                return all(data.find(text.encode()) >= 0 for text in texts)
        content = json.dumps(load(path))
    except (OSError, ValueError, DatasetError):  # an empty file cannot be mapped
        return False
    return all(text in content for text in texts)
