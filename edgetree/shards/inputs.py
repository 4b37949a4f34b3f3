"""The files of a source, in a folder or at a URL, and the frames in some of them."""

from __future__ import annotations

import hashlib
import json
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final, NamedTuple

from basetree.errors import InputError
from basetree.files.names import IMAGE_SUFFIXES, VIDEO_SUFFIXES
from basetree.jobs import LocalStore, Store, fetch, open_store
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.bags.names import BAG_SUFFIXES
from edgetree.sources.depth_pairing import depth_names, frame_names
from edgetree.sources.files import open_image_files
from edgetree.sources.opening import open_frames
from edgetree.sources.source import FrameSource

_RECORDINGS: Final = (*VIDEO_SUFFIXES, *BAG_SUFFIXES)


class _Entry(NamedTuple):
    """A file of a source: name of the frame, the file, and its depth file if there is one.

    `bytes_` are the sizes of the two, None for one that is not there.
    """

    name: str
    file: str
    depth: str | None
    bytes_: tuple[int | None, int | None]


class FramesOfUnit(NamedTuple):
    """Frames, the folders on this machine that stand for the source's, and what is read."""

    frames: Iterator[Frame]
    folders: dict[str, str]
    source: FrameSource


@dataclass(frozen=True)
class FrameFiles:
    """Images, or recordings.

    Attributes:
        source: Folder or URL.
        depth: Folder or URL of the depth images; None if there are none.
        entries: The files by name.
        are_recordings: Whether the files are videos or recordings of ROS.
        missing_depth: Names of depth files that do not exist.
    """

    source: Store
    depth: Store | None
    entries: tuple[_Entry, ...]
    are_recordings: bool
    missing_depth: frozenset[str] = frozenset()

    @property
    def digest(self) -> str:
        """SHA-256 of the names and sizes of all files."""
        return hashlib.sha256(json.dumps(self.entries).encode("utf-8", "replace")).hexdigest()

    @contextmanager
    def frames(
        self, start: int, count: int, rig: Rig, *, depth_only: bool
    ) -> Iterator[FramesOfUnit]:
        """Open some of the files; those at a URL are copied to this machine meanwhile.

        Args:
            start: Number of the first file.
            count: Number of files.
            rig: Cameras and depth unit.
            depth_only: Whether the files contain depth images instead of colour images.

        Raises:
            InputError: a recording cannot be read. Iterating may raise it for a frame and then go
                on with the next one.
            StoreError: a file at a URL cannot be read.
        """
        entries = self.entries[start : start + count]
        with tempfile.TemporaryDirectory() as folder:
            images = _here(self.source, [e.file for e in entries], Path(folder) / "images")
            names = [e.depth for e in entries if e.depth and e.depth not in self.missing_depth]
            depths = (
                None if self.depth is None else _here(self.depth, names, Path(folder) / "depth")
            )
            folders = {str(images): self.source.where}
            if depths is not None and self.depth is not None:
                folders[str(depths)] = self.depth.where
            if self.are_recordings:
                (entry,) = entries
                with closing(open_frames(images / entry.file, rig=rig)) as frames:
                    yield FramesOfUnit(iter(frames), folders, frames)
                return
            files = [
                (e.name, images / e.file, depths / e.depth if depths and e.depth else None)
                for e in entries
            ]
            opened = open_image_files(files, depth_only=depth_only, rig=rig)
            yield FramesOfUnit(iter(opened), folders, opened)


def _here(store: Store, names: list[str], folder: Path) -> Path:
    """A folder of this machine with files of a store; copies them if they are elsewhere."""
    if isinstance(store, LocalStore):
        return store.folder
    fetch(store, names, folder)
    return folder


def list_frames(source: Path, depth: Path | None) -> FrameFiles:
    """List the files of a folder or URL: images with their depth images, or recordings.

    Args:
        source: Folder or URL of images or of recordings; or one recording.
        depth: Folder or URL with a depth image of the same stem for each image.

    Raises:
        InputError: There are no images or recordings, or no image has depth.
        StoreError: a place cannot be read.
    """
    if source.suffix.lower() in _RECORDINGS and source.is_file():
        entry = _Entry(source.stem, source.name, None, (source.stat().st_size, None))
        return FrameFiles(LocalStore(source.parent), None, (entry,), are_recordings=True)
    store = open_store(source)
    sizes = store.sizes("")
    files = sorted(
        name
        for name in sizes
        if not name.startswith(".") and _suffix(name) in (*IMAGE_SUFFIXES, *_RECORDINGS)
    )
    images = [name for name in files if _suffix(name) in IMAGE_SUFFIXES]
    if not files:
        raise InputError(
            f"source {store.where} has no images and no recordings: expected"
            f" {', '.join((*IMAGE_SUFFIXES, *_RECORDINGS))}"
        )
    if not images:
        if depth is not None:
            raise InputError(f"--depth given for recordings in {store.where}: expected images")
        entries = tuple(
            _Entry(PurePosixPath(name).stem, name, None, (sizes[name], None)) for name in files
        )
        return FrameFiles(store, None, entries, are_recordings=True)
    depths: list[str | None] = [None] * len(images)
    depth_store, missing = None, frozenset[str]()
    depth_sizes: dict[str, int] = {}
    paths = [PurePosixPath(name) for name in images]
    if depth is not None:
        depth_store = open_store(depth)
        depth_sizes = depth_store.sizes("")
        paired = depth_names(paths, depth_sizes, store.where, depth_store.where)
        depths, missing = [*paired.names], paired.missing
    bytes_ = [
        (sizes[image], None if depth is None else depth_sizes.get(depth))
        for image, depth in zip(images, depths, strict=True)
    ]
    entries = tuple(map(_Entry, frame_names(paths), images, depths, bytes_))
    return FrameFiles(store, depth_store, entries, are_recordings=False, missing_depth=missing)


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower()
