"""Where the pictures of a written dataset lie, and their copying."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from basetree.counts import counted
from basetree.files.headers.formats import picture_header
from basetree.files.headers.header import NotOffered
from basetree.files.regular import read_regular
from basetree.files.writing import write_whole
from perceptree.data.coco import FrameRecord
from perceptree.errors import DatasetError

_TURNED_BY_A_QUARTER = 5  # and more: EXIF orientations that change width and height


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
        self._labelled_px = {frame.image_path: (frame.width, frame.height) for frame in frames}
        self._other_sizes: dict[Path, str] = {}

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
            self._compare_size(path, data)
            write_whole(target, data)
            self._copied.add(inside)
        return inside

    def _compare_size(self, path: Path, data: bytes) -> None:
        """Note a colour picture of another size than its labels say."""
        wanted = self._labelled_px.get(path)
        try:
            header = picture_header(data)
        except NotOffered:
            header = None
        if header is None or not header.is_whole or wanted is None:
            return
        stored = header.width, header.height
        is_turned = header.orientation >= _TURNED_BY_A_QUARTER and wanted == stored[::-1]
        if wanted != stored and not is_turned:
            sizes = "{}x{} px and in its labels {}x{} px".format(*stored, *wanted)
            self._other_sizes[path] = f"{path} is {sizes}"

    def notes(self) -> list[str]:
        """Return a message for the user if copied pictures have another size than labels say."""
        if not self._other_sizes:
            return []
        count = counted(len(self._other_sizes), "picture")
        first = next(iter(self._other_sizes.values()))
        return [f"{count} of another size than in the labels, so that these do not fit: {first}"]

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
