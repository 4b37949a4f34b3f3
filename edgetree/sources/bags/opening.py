"""Open the files of a recording by their first bytes, whatever their names are."""

from __future__ import annotations

import tempfile
from collections.abc import Collection, Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

from basetree.errors import InputError, MissingPackage, install_hint
from basetree.files.reading import read_text
from calib.files.yaml_text import parse_yaml
from edgetree.sources.bags.bounded import ZSTD_MAGIC, Budget, open_bounded, zstd_parts
from edgetree.sources.bags.names import (
    BAG_SUFFIXES,
    MCAP_MAGIC,
    ROS1_MAGIC,
    other_recording,
    storage_files,
)
from edgetree.sources.bags.storage import Channel, Storage, Stored

_SQLITE_MAGIC: Final = b"SQLite format 3\0"
_OTHER_MAGICS: Final = {
    b"\x1f\x8b": "packed by gzip",
    b"BZh": "packed by bzip2",
    b"\x04\x22\x4d\x18": "packed by lz4",
    b"PK\x03\x04": "a zip archive",
    b"\xfd7zXZ": "packed by xz",
}


def recording_files(path: Path) -> list[Path]:
    """The files of a recording: the file itself, or those in its folder.

    Raises:
        InputError: There are none.
    """
    if not path.exists():
        raise InputError(
            f"recording {path} does not exist: expected a file ({', '.join(BAG_SUFFIXES)}) or the"
            " folder of a ROS 2 bag"
        )
    if not path.is_dir():
        if path.stat().st_size == 0:
            raise InputError(f"recording {path} is empty: expected messages")
        return [path]
    files = [file for file in storage_files(path) if file.stat().st_size]
    if not files:
        raise InputError(
            f"recording {path} has no files of messages: expected {', '.join(BAG_SUFFIXES)}, also"
            " with .active or .zstd"
        )
    return files


def empty_files(path: Path) -> list[str]:
    """Names of the files of a folder that hold nothing, as a crash leaves them."""
    files = storage_files(path) if path.is_dir() else []
    return [file.name for file in files if not file.stat().st_size]


def missing_files(path: Path) -> list[str]:
    """Names of the files that the metadata.yaml of a folder lists and that are not there."""
    metadata = path / "metadata.yaml"
    if not metadata.is_file() or metadata.stat().st_size == 0:  # written when a recording ends
        return []
    try:
        (content,) = parse_yaml(read_text(metadata, "the metadata of a ROS 2 bag"))
        names = content["rosbag2_bagfile_information"]["relative_file_paths"]
        listed = [Path(str(name)).name for name in names]
    except (ValueError, KeyError, TypeError, RecursionError, InputError):
        return []
    packed = ("", ".zstd", ".zst")
    there = {file.name for file in path.iterdir()}
    return [name for name in listed if not any(f"{name}{end}" in there for end in packed)]


def open_storage(path: Path, shown: Path | None = None) -> Storage:
    """Open a file of a recording.

    Args:
        path: The file.
        shown: The path for messages; the same if None.

    Raises:
        InputError: Its first bytes are those of no recording.
        MissingPackage: Rosbags is not installed.
        Exception: It is broken; the packages that read it have errors of many kinds.
    """
    with open_bounded(path) as file:
        start = file.read(16)
    if start.startswith(ZSTD_MAGIC):
        return _Unpacked(path)
    try:
        if start.startswith(MCAP_MAGIC):
            from edgetree.sources.bags.mcap_file import McapFile

            return McapFile(path)
        if start.startswith(ROS1_MAGIC):
            from edgetree.sources.bags.ros1_file import Ros1File

            return Ros1File(path)
    except ImportError as error:
        raise MissingPackage(
            f"{error.name} is not installed, which recordings need: {install_hint('record')}"
        ) from error
    if start.startswith(_SQLITE_MAGIC):
        from edgetree.sources.bags.sqlite_file import SqliteFile

        return SqliteFile(path)
    what = next((what for magic, what in _OTHER_MAGICS.items() if start.startswith(magic)), None)
    what = f"it is {what}, expected it unpacked" if what else other_recording(path)
    raise InputError(
        f"recording {shown or path} cannot be read:"
        f" {what or 'by its first bytes it is none, expected a ROS 1 bag, ROS 2 bag or MCAP file'}"
    )


class _Unpacked:
    """A file that was packed as a whole, unpacked to a temporary folder; as `Storage`."""

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="edgetree-")
        try:
            unpacked = Path(self._folder.name, path.stem)
            _unpack(path, unpacked)
            with unpacked.open("rb") as file:
                if file.read(4) == ZSTD_MAGIC:
                    raise InputError(f"recording {path} is packed twice: expected it packed once")
            self._storage = open_storage(unpacked, path)
        except BaseException:
            self._folder.cleanup()
            raise
        self.channels, self.is_cut_off = self._storage.channels, self._storage.is_cut_off
        self.start_ns, self.end_ns = self._storage.start_ns, self._storage.end_ns

    def messages(self, channels: Collection[Channel]) -> Iterator[Stored]:
        """Yield the messages of channels in the order of time."""
        return self._storage.messages(channels)

    def close(self) -> None:
        """Close the file and remove the unpacked one."""
        self._storage.close()
        self._folder.cleanup()


def _unpack(path: Path, unpacked: Path) -> None:
    with closing(open_bounded(path)) as packed:
        budget = Budget(packed.size)
        try:
            with unpacked.open("wb") as file:
                for part in zstd_parts(packed):
                    budget.spend(len(part))
                    file.write(part)
        except OSError as error:
            raise InputError(
                f"recording {path} cannot be unpacked to {unpacked.parent} ({error.strerror}):"
                " expected room there, or another folder in TMPDIR"
            ) from error
