"""What the fuzzer knows of a format."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


class Format(NamedTuple):
    """A kind of file.

    Attributes:
        seeds: valid files.
        read: the function that reads a path.
        refused: what the seeds are refused with, for formats whose valid files are too large.
    """

    seeds: tuple[bytes, ...]
    read: Callable[[Path], object]
    refused: str = ""
