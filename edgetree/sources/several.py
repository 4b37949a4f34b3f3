"""Several sources as one: files and folders one after the other."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import NamedTuple

from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.files import no_such_source, open_image_files, open_source
from edgetree.sources.folders import depth_alone, folder_files, with_depth
from edgetree.sources.opening import is_stream
from edgetree.sources.picture_names import is_image_name
from edgetree.sources.source import BaseSource, FrameSource
from edgetree.sources.source_list import SourceList


class _Picture(NamedTuple):
    """An image file, its depth file, and whether it is depth itself."""

    path: Path
    depth: Path | None
    is_depth: bool


def open_several(
    sources: SourceList,
    depth: Path | None,
    *,
    rig: Rig,
    open_one: Callable[[Path], FrameSource],
    takes_depth: bool = False,
    upright: bool = True,
) -> FrameSource:
    """Open several sources, one after the other.

    Args:
        sources: What to open.
        depth: Folder with the depth images of all pictures; those of a folder may be in the folder
            of the same name in it.
        rig: Cameras and depth unit.
        open_one: Opens what is no picture and no folder of pictures when its turn comes.
        takes_depth: Whether pictures without depth are depth themselves, as the model takes it.
        upright: As for `open_source`.

    Returns:
        The frames. Their names differ: they begin with the names of folders where the same file
        name is in several. Iterating is as for `open_source`; what cannot be opened raises
        `InputError` when its turn comes, and the iteration goes on with the next one.

    Raises:
        InputError: A file is missing, or has depth while others have none.
    """
    parts: list[_Picture | Path] = []
    for folder, paths in groupby(sources.paths, _folder_of_picture):
        if folder is not None:
            parts += _loose_pictures(list(paths), folder, depth, takes_depth)
            continue
        for path in paths:
            parts += _parts(path, depth, sources, takes_depth)
    pictures = [part for part in parts if isinstance(part, _Picture)]
    names = dict(zip((each.path for each in pictures), _names(pictures), strict=True))
    opens: list[Callable[[], FrameSource]] = []
    for is_depth, group in groupby(
        parts, lambda part: isinstance(part, _Picture) and part.is_depth
    ):
        for part in _joined(group):
            if isinstance(part, Path):
                opens.append(lambda path=part: open_one(path))  # type: ignore[misc]
                continue
            files = [(names[each.path], each.path, each.depth) for each in part]
            opens.append(
                lambda files=files, is_depth=is_depth: open_image_files(  # type: ignore[misc]
                    files, depth_only=is_depth, rig=rig, upright=upright
                )
            )
    count = len(pictures) if len(pictures) == len(parts) else None
    return _Chain(sources.name, opens, count)


def open_pictures(
    sources: SourceList, depth: Path | None = None, *, upright: bool = True
) -> FrameSource:
    """Open one or several images, folders of images or videos; as `open_source`.

    Args:
        sources: What to open.
        depth: Depth image of an image, or folder with the depth images of all pictures.
        upright: As for `open_source`.

    Raises:
        InputError: As for `open_source` and `open_several`.
    """
    if sources.one is not None:
        return open_source(sources.one, depth, upright=upright)

    def open_one(path: Path) -> FrameSource:
        return open_source(path, depth, upright=upright)

    return open_several(sources, depth, rig=Rig(), open_one=open_one, upright=upright)


def _joined(parts: Iterator[_Picture | Path]) -> Iterator[list[_Picture] | Path]:
    """Pictures that follow each other as one list."""
    for is_path, group in groupby(parts, lambda part: isinstance(part, Path)):
        if is_path:
            yield from (part for part in group if isinstance(part, Path))
        else:
            yield [part for part in group if isinstance(part, _Picture)]


def _folder_of_picture(path: Path) -> Path | None:
    """The folder of an image file; None for a folder and for another file."""
    return path.parent if is_image_name(path) and path.is_file() else None


def _loose_pictures(
    paths: list[Path], folder: Path, depth: Path | None, takes_depth: bool
) -> list[_Picture]:
    """Image files of one folder that were named or matched by themselves."""
    return [
        _Picture(path, its, takes_depth and its is None)
        for path, its in _kept(lambda: with_depth(paths, depth, folder), paths, depth)
    ]


def _parts(
    path: Path, depth: Path | None, sources: SourceList, takes_depth: bool
) -> list[_Picture] | list[Path]:
    """What a file or folder adds: the pictures of a folder, or itself if it is none."""
    if not path.exists():
        raise no_such_source(path)
    if not path.is_dir() or is_stream(path):
        return [path]
    alone = depth_alone(path, depth)
    below = None if depth is None or alone else _same_folder(path, depth, sources.typed)
    is_depth = alone is not None or (below is None and takes_depth)
    files = folder_files(alone or path, depth_only=is_depth)
    if below is not None:
        files = _kept(lambda: folder_files(path, below), [each for each, _ in files], below)
    return [_Picture(each, its, is_depth and its is None) for each, its in files]


_Files = list[tuple[Path, Path | None]]


def _kept(pair: Callable[[], _Files], paths: Sequence[Path], depth: Path | None) -> _Files:
    """Pictures with their depth; if none has any, each says so when its turn comes."""
    try:
        return pair()
    except InputError:
        if depth is None or not depth.is_dir():
            raise
        return [(path, depth / f"{path.stem}.png") for path in paths]


def _same_folder(folder: Path, depth: Path, roots: Sequence[Path]) -> Path:
    """The folder in the depth's that has the place of a folder below those that were typed."""
    for root in roots:
        if root in folder.parents and (depth / folder.relative_to(root)).is_dir():
            return depth / folder.relative_to(root)
    return depth / folder.name if (depth / folder.name).is_dir() else depth


def _names(pictures: Sequence[_Picture]) -> list[str]:
    """Names of frames that differ: stems; those of one stem have as many folders as it takes."""
    paths = [each.path for each in pictures]
    alike: dict[str, list[int]] = {}
    for at, path in enumerate(paths):
        alike.setdefault(path.stem, []).append(at)
    names = [path.stem for path in paths]
    for stem, group in alike.items():
        parents = Counter(paths[at].parent for at in group)
        last = [stem if parents[paths[at].parent] == 1 else paths[at].name for at in group]
        deepest = max(len(paths[at].parts) for at in group)
        for folders in range(deepest):
            found = [
                "_".join((*_last_folders(paths[at], folders), name))
                for at, name in zip(group, last, strict=True)
            ]
            if len(set(found)) == len(group):
                break
        for at, name in zip(group, found, strict=True):
            names[at] = name
    return _numbered(names)


def _last_folders(path: Path, count: int) -> tuple[str, ...]:
    folders = [name for name in path.parts[:-1] if name not in (path.anchor, "..")]
    return tuple(folders[len(folders) - count :]) if count <= len(folders) else tuple(folders)


def _numbered(names: Sequence[str]) -> list[str]:
    """Names of which those that are still the same get a number."""
    seen = Counter[str]()
    taken = set[str]()
    unique = []
    for name in names:
        found = name
        while found in taken:
            seen[name] += 1
            found = f"{name}_{seen[name] + 1}"
        taken.add(found)
        unique.append(found)
    return unique


class _Chain(BaseSource):
    """Sources one after the other, each opened when its turn comes; names of frames differ."""

    def __init__(
        self, name: str, opens: Sequence[Callable[[], FrameSource]], count: int | None
    ) -> None:
        super().__init__(name)
        self.count = count
        self._opens, self._taken = iter(opens), set[str]()
        self._source: FrameSource | None = None
        self._frames: Iterator[Frame] = iter(())
        self._before = Counter[str]()

    def __iter__(self) -> Iterator[Frame]:
        return self

    def __next__(self) -> Frame:
        while not self._is_closed.is_set():
            try:
                frame = next(self._frames)
            except StopIteration:
                self._count()
                self._before, self._source, self._frames = self.counts, None, iter(())
                self._source = next(self._opens)()
                self._frames = iter(self._source)
                continue
            self._count()
            return self._named(frame)
        raise StopIteration

    def close(self) -> None:
        """End the iteration and release what is open."""
        super().close()
        if self._source is not None:
            self._source.close()

    def _count(self) -> None:
        counts = {} if self._source is None else self._source.counts
        self.counts = self._before + Counter(counts)

    def _named(self, frame: Frame) -> Frame:
        name = frame.name
        if name in self._taken and frame.path is not None:
            name = f"{frame.path.parent.name}_{name}"
        number = 2
        while name in self._taken:
            name, number = f"{frame.name}_{number}", number + 1
        self._taken.add(name)
        return frame if name == frame.name else replace(frame, name=name)
