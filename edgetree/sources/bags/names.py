"""Which files and folders are recordings, by their names and first bytes."""

import re
from pathlib import Path
from typing import Final

from basetree.files.regular import open_regular

MCAP_MAGIC: Final = b"\x89MCAP0\r\n"
ROS1_MAGIC: Final = b"#ROSBAG "
BAG_SUFFIXES: Final = (".bag", ".mcap", ".db3")
# A file that is still written, or was when the power failed, and one that rosbag2 has packed.
_MORE_SUFFIXES: Final = (".active", ".zstd", ".zst")
_PACKED_SUFFIXES: Final = (".gz", ".bz2", ".lz4", ".xz", ".zip")  # which are not read
_NUMBER: Final = re.compile(r"(\d+)")
_ZED: Final = "a recording of a ZED camera: export it to pictures and depth by ZED's tools"
_OTHER_RECORDINGS: Final = {
    ".svo": _ZED,
    ".svo2": _ZED,
    ".oni": "a recording of OpenNI: export it to pictures and depth",
    ".klg": "a recording of Logger1: export it to pictures and depth",
    ".rrd": "a recording of Rerun: export it to MCAP, or to pictures and depth",
    ".pcap": "packets of a network: convert them to a recording of ROS",
    ".pcapng": "packets of a network: convert them to a recording of ROS",
    ".db": "a database, perhaps of RTAB-Map: export its pictures, depth and poses",
}


def is_bag(path: Path) -> bool:
    """Whether a path looks like a recording by its name, its start, or the names in its folder.

    One that is packed in a way that is not read counts too, so that it is refused as such.
    """
    if path.is_dir():
        return (path / "metadata.yaml").is_file() or bool(storage_files(path))
    if path.suffix.lower() in _PACKED_SUFFIXES and is_storage_name(path.with_suffix("")):
        return True
    return is_storage_name(path) or _starts_as_one(path)


def _starts_as_one(path: Path) -> bool:
    if not path.is_file():
        return False
    try:
        with open_regular(path) as file:
            return file.read(len(MCAP_MAGIC)).startswith((MCAP_MAGIC, ROS1_MAGIC))
    except OSError:
        return False


def is_storage_name(path: Path) -> bool:
    """Whether a name is that of a file of a recording: a.bag, a.bag.active, a.mcap.zstd."""
    suffixes = [suffix.lower() for suffix in path.suffixes[-2:]]
    if not suffixes:
        return False
    if suffixes[-1] in _MORE_SUFFIXES:
        return len(suffixes) == 2 and suffixes[0] in BAG_SUFFIXES
    return suffixes[-1] in BAG_SUFFIXES


def storage_files(folder: Path) -> list[Path]:
    """The files of a recording in its folder, in the order of the numbers in their names."""
    files = [path for path in folder.iterdir() if is_storage_name(path) and path.is_file()]
    # A file that is still there beside its packed form is the same content twice.
    names = {path.name for path in files}
    files = [path for path in files if not _is_packed(path) or path.stem not in names]
    return sorted(files, key=_number_key)


def _is_packed(path: Path) -> bool:
    return path.suffix.lower() in _MORE_SUFFIXES[1:]


def _number_key(path: Path) -> list[tuple[int, int | str]]:
    parts = _NUMBER.split(path.name)
    return [(0, int(part)) if part.isdigit() else (1, part) for part in parts if part]


def other_recording(path: Path) -> str | None:
    """What a recording is that is not read, and what to do; None if its name does not tell."""
    what = _OTHER_RECORDINGS.get(path.suffix.lower())
    return None if what is None else f"it is {what}"
