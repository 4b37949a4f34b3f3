"""Where the pictures of a written dataset lie, and their copying."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from basetree.files.regular import read_regular
from basetree.files.writing import write_whole
from perceptree.data.coco import FrameRecord
from perceptree.errors import DatasetError


class Places:
    """Names of the pictures in a new folder: their own, with that of their folder if needed."""

    def __init__(self, out: Path, frames: Sequence[FrameRecord]) -> None:
        """Choose the names.

        Args:
            out: The new folder.
            frames: All frames of the dataset.
        """
        self._out = out
        paths = list(dict.fromkeys(frame.image_path for frame in frames))
        self._names = _unique_names(paths)
        self._names_of_depth: dict[Path, str] = {}
        for frame in frames:
            for path in (frame.depth_path, frame.depth8_path, frame.exact_path):
                if path is not None:
                    own = Path(self._names[frame.image_path])
                    self._names_of_depth[path] = own.with_suffix(path.suffix).name
        self._copied: set[str] = set()

    def copy(self, path: Path, *folders: str) -> str:
        """Copy a picture into a folder of the new one, once.

        Returns:
            Its name below the new folder.

        Raises:
            DatasetError: If it cannot be read.
        """
        name = self._names.get(path) or self._names_of_depth[path]
        inside = "/".join((*folders, name))
        if inside not in self._copied:
            target = self._out.joinpath(*folders, name)
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                data = read_regular(path)
            except OSError as error:
                reason = error.strerror or "not a file"
                raise DatasetError(f"{path}: picture cannot be read ({reason})") from error
            write_whole(target, data)
            self._copied.add(inside)
        return inside

    def stem(self, frame: FrameRecord) -> str:
        """Return the name of a frame's picture without its suffix."""
        return Path(self._names[frame.image_path]).stem


def _unique_names(paths: Sequence[Path]) -> dict[Path, str]:
    """Short names of files: no two have the same one without suffix, in any mixture of case."""
    depth = 1
    while True:
        names = {path: "-".join(path.parts[-depth:]) for path in paths}
        stems = {os.path.splitext(name)[0].casefold() for name in names.values()}
        if len(stems) == len(names):
            return names
        depth += 1
        if depth > max(len(path.parts) for path in paths):
            return {path: f"{number:06d}-{path.name}" for number, path in enumerate(paths)}
