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
from basetree.files.names import VIDEO_SUFFIXES
from basetree.jobs import LocalStore, Store, fetch, is_url, open_store
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.bags.names import BAG_SUFFIXES, storage_files
from edgetree.sources.depth_pairing import COLOUR_FOLDERS, depth_names, frame_names
from edgetree.sources.drive import is_drive
from edgetree.sources.files import open_image_files
from edgetree.sources.folders import depth_alone, folder_files, has_images
from edgetree.sources.opening import open_frames
from edgetree.sources.phones.opening import is_capture
from edgetree.sources.picture_names import image_suffixes, in_order, with_files
from edgetree.sources.source import FrameSource

_RECORDINGS: Final = (*VIDEO_SUFFIXES, *BAG_SUFFIXES)
_METADATA: Final = "metadata.yaml"  # of the folder of a ROS 2 bag, whose files are one recording


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
        are_recordings: Whether the files are videos, recordings of ROS, captures or drives.
        are_depth: Whether the images are depth images instead of colour images.
        missing_depth: Names of depth files that do not exist.
    """

    source: Store
    depth: Store | None
    entries: tuple[_Entry, ...]
    are_recordings: bool
    are_depth: bool = False
    missing_depth: frozenset[str] = frozenset()

    @property
    def digest(self) -> str:
        """SHA-256 of the names and sizes of all files."""
        return hashlib.sha256(json.dumps(self.entries).encode("utf-8", "replace")).hexdigest()

    @contextmanager
    def frames(self, start: int, count: int, rig: Rig) -> Iterator[FramesOfUnit]:
        """Open some of the files; those at a URL are copied to this machine meanwhile.

        Args:
            start: Number of the first file.
            count: Number of files.
            rig: Cameras and depth unit.

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
                try:
                    recording = open_frames(images / entry.file, rig=rig)
                except InputError as error:  # names the copy of a file at a URL
                    told = str(error).replace(str(images), self.source.where)
                    raise InputError(told) from error
                with closing(recording) as frames:
                    yield FramesOfUnit(iter(frames), folders, frames)
                return
            files = [
                (e.name, images / e.file, depths / e.depth if depths and e.depth else None)
                for e in entries
            ]
            opened = open_image_files(files, depth_only=self.are_depth, rig=rig)
            yield FramesOfUnit(iter(opened), folders, opened)


def _here(store: Store, names: list[str], folder: Path) -> Path:
    """A folder of this machine with files of a store; copies them if they are elsewhere."""
    if isinstance(store, LocalStore):
        return store.folder
    fetch(store, names, folder)
    return folder


def list_frames(source: Path, depth: Path | None, *, takes_depth: bool = False) -> FrameFiles:
    """List the files of a folder or URL: images with their depth images, or recordings.

    Images of a folder on this machine, their order and their depth are those of `open_source`. A
    ROS 2 bag, a drive or the capture of a phone is one recording.

    Args:
        source: Folder or URL of images or of recordings; or one recording.
        depth: Folder or URL with a depth image of the same stem for each image.
        takes_depth: Whether images without depth are depth themselves, as the model takes it.

    Raises:
        InputError: There are no images or recordings, or no image has depth.
        StoreError: a place cannot be read.
    """
    if _is_one_recording(source):
        if depth is not None:
            raise InputError(f"--depth given for the recording {source}: expected images")
        entry = _Entry(source.stem, source.name, None, (_bytes_of(source), None))
        return FrameFiles(LocalStore(source.parent), None, (entry,), are_recordings=True)
    store = open_store(source)
    sizes = store.sizes("")
    named = [name for name in sizes if not name.startswith(".")]
    images = [name for name in named if _suffix(name) in image_suffixes()]
    recordings = sorted(name for name in named if _suffix(name) in _RECORDINGS)
    is_here = source.is_dir() and (depth is None or not is_url(depth))
    if is_here and (images or (not recordings and _has_pictures_inside(source, depth))):
        return _of_folder(source, depth, takes_depth)
    if not images and not recordings:
        raise InputError(
            f"source {store.where} has no images and no recordings: expected"
            f" {', '.join((*image_suffixes(), *_RECORDINGS))}"
        )
    if not images:
        if depth is not None:
            raise InputError(f"--depth given for recordings in {store.where}: expected images")
        entries = tuple(
            _Entry(PurePosixPath(name).stem, name, None, (sizes[name], None)) for name in recordings
        )
        return FrameFiles(store, None, entries, are_recordings=True)
    paths = in_order(map(PurePosixPath, images))
    if depth is None:
        entries = tuple(
            _Entry(name, path.name, None, (sizes[path.name], None))
            for name, path in zip(frame_names(paths), paths, strict=True)
        )
        return FrameFiles(store, None, entries, are_recordings=False, are_depth=takes_depth)
    depth_store = open_store(depth)
    depth_sizes = depth_store.sizes("")
    paired = depth_names(paths, depth_sizes, store.where, depth_store.where)
    entries = tuple(
        _Entry(name, path.name, other, (sizes[path.name], depth_sizes.get(other)))
        for name, path, other in zip(frame_names(paths), paths, paired.names, strict=True)
    )
    return FrameFiles(
        store, depth_store, entries, are_recordings=False, missing_depth=paired.missing
    )


def _is_one_recording(source: Path) -> bool:
    if source.is_dir():
        is_bag = (source / _METADATA).is_file() and bool(storage_files(source))
        return is_drive(source) or is_capture(source) or (is_bag and not has_images(source))
    return source.suffix.lower() in _RECORDINGS and source.is_file()


def _bytes_of(path: Path) -> int:
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file.is_file())


def _has_pictures_inside(folder: Path, depth: Path | None) -> bool:
    """Whether a folder without pictures holds a folder of them, or depth alone."""
    inside = with_files(folder, COLOUR_FOLDERS, image_suffixes())
    return has_images(inside) or depth_alone(folder, depth) is not None


def _of_folder(folder: Path, depth: Path | None, takes_depth: bool) -> FrameFiles:
    """The images of a folder of this machine, with their depth images."""
    alone = depth_alone(folder, depth)
    if alone is not None:
        folder, depth, takes_depth = alone, None, True
    files = folder_files(folder, depth, depth_only=depth is None and takes_depth)
    names = frame_names([path for path, _ in files])
    depths = [depth for _, depth in files if depth is not None]
    entries = tuple(
        _Entry(
            name,
            path.name,
            None if depth is None else depth.name,
            (_bytes_of(path), None if depth is None or not depth.is_file() else _bytes_of(depth)),
        )
        for name, (path, depth) in zip(names, files, strict=True)
    )
    return FrameFiles(
        LocalStore(files[0][0].parent),
        LocalStore(depths[0].parent) if depths else None,
        entries,
        are_recordings=False,
        are_depth=not depths and takes_depth and depth is None,
        missing_depth=frozenset(depth.name for depth in depths if not depth.is_file()),
    )


def _suffix(name: str) -> str:
    return PurePosixPath(name).suffix.lower()
