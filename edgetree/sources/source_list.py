"""The files and folders that names and patterns on the command line stand for."""

from __future__ import annotations

import glob
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from basetree.errors import InputError
from calib.clouds import is_cloud_file
from edgetree.sources.depth_there import has_depth
from edgetree.sources.files import as_typed
from edgetree.sources.folders import depth_inside
from edgetree.sources.opening import is_stream
from edgetree.sources.picture_names import in_order, is_image_name
from edgetree.sources.videos import is_video


@dataclass(frozen=True)
class SourceList:
    """What was typed, and the files and folders that it stands for.

    Attributes:
        typed: Names and patterns as typed.
        paths: Files and folders, each once.
    """

    typed: tuple[Path, ...]
    paths: tuple[Path, ...]

    @property
    def one(self) -> Path | None:
        """The only file or folder; None if there are several."""
        return self.paths[0] if len(self.paths) == 1 else None

    @property
    def name(self) -> str:
        """What was typed, for titles and messages."""
        return " ".join(map(as_typed, self.typed))

    @property
    def common(self) -> Path | None:
        """The folder that all of several files and folders are in; None for one, or if none is."""
        if self.one is not None:
            return None
        places = [path if path.is_dir() else path.parent for path in self.paths]
        try:
            return Path(os.path.commonpath([place.absolute() for place in places]))
        except ValueError:  # on different drives of Windows
            return None

    def by_name(self) -> dict[str, Path]:
        """The files and folders by what messages call them."""
        if self.one is not None:
            return {"source": self.one}
        return {f"source {number}": path for number, path in enumerate(self.paths, 1)}

    def has_depth(self, topics: Mapping[str, str]) -> bool:
        """Whether the sources bring depth, beside pictures or alone.

        Args:
            topics: Names of topics by role, for recordings.

        Raises:
            InputError: Some have and some have not, so that no model fits all; or one is a
                recording that cannot be opened.
        """
        found = [has_depth(path, topics=topics) for path in self.paths]
        if any(found) and not all(found):
            having, other = (self.paths[found.index(each)] for each in (True, False))
            raise InputError(
                f"source {having} has depth and {other} has none: expected depth for all or for"
                " none; run them one after the other"
            )
        return all(found)


def list_sources(typed: Sequence[Path], *, recursive: bool = False) -> SourceList:
    """Find the files and folders that names and patterns stand for.

    A name that exists is taken as it is. Another may be a pattern with `*`, `?`, `[...]` and, for
    all folders below, `**`, which need no shell: it may be quoted, and works on Windows. Of what it
    matches, pictures, videos, recordings, captures and clouds are taken, or else folders.

    Args:
        typed: Names and patterns.
        recursive: Whether to take the folders of pictures below each folder too. Links to folders
            are not followed.

    Raises:
        InputError: Nothing matches a pattern, or there are no pictures below a folder.
    """
    found: dict[Path, Path] = {}
    for name in typed:
        for path in [name] if os.path.lexists(name) or not _is_pattern(name) else _matching(name):
            below = _picture_folders(path) if recursive and path.is_dir() else [path]
            for each in below:
                found.setdefault(each.resolve(), each)
    return SourceList(tuple(typed), tuple(found.values()))


def _is_pattern(name: Path) -> bool:
    return glob.has_magic(str(name)) and "://" not in as_typed(name)


def _matching(pattern: Path) -> list[Path]:
    matches = [Path(name) for name in glob.iglob(str(pattern), recursive=True)]
    wanted = [path for path in matches if _is_source(path)]
    if not wanted:
        other = f", only others such as {matches[0]}" if matches else ""
        raise InputError(
            f"source {pattern} matches no picture, video or recording{other}: expected one"
        )
    # A folder that stands for its pictures does not hide that they were matched themselves.
    files = [path for path in wanted if not path.is_dir() or is_stream(path)]
    return in_order(files or wanted)


def _is_source(path: Path) -> bool:
    if is_image_name(path) or path.is_dir() or is_stream(path):
        return True
    return path.is_file() and (is_cloud_file(path) or is_video(path))


def _picture_folders(folder: Path) -> list[Path]:
    """A folder and those below it that hold pictures or a recording, in the order of names."""
    found: list[Path] = []
    for name, below, _ in os.walk(folder):
        below[:] = sorted(each for each in below if not each.startswith("."))
        here = Path(name)
        if is_stream(here) or depth_inside(here) not in (None, here):
            found.append(here)
            below.clear()
        elif any(map(is_image_name, here.iterdir())):
            found.append(here)
    if not found:
        raise InputError(
            f"folder {folder} and the folders below it have no pictures: expected some"
        )
    return found
