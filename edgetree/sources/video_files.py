"""What video files say of themselves: their kind, and whether they are whole."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import BinaryIO, Final

import numpy as np

_HEAD_BYTES: Final = 1024
_MOST_BOXES: Final = 1_000_000
_MP4_BOXES: Final = (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide", b"styp", b"pnot")
_STARTS: Final = (
    b"\x1aE\xdf\xa3",  # Matroska, WebM
    b"FLV\x01",
    b"OggS",
    b"0&\xb2u\x8ef\xcf\x11",  # ASF, WMV
    b"\x00\x00\x01",  # MPEG streams, raw H.264 and H.265
    b"\x00\x00\x00\x01",
    b".RMF",
    b"DKIF",
    b"\x06\x0e+4",  # MXF
    b"YUV4MPEG2 ",
    b"\x1f\x07\x00",  # DV
)
_LISTS: Final = (b"ffconcat version", b"#EXTM3U", b"[playlist]", b"<?xml", b"v=0")
_TS_SYNC: Final = 0x47
_TS_PACKETS: Final = ((188, 0), (192, 4))  # bytes of a packet, where its sync byte is
_EBML, _SEGMENT, _CLUSTER = 0x1A45DFA3, 0x18538067, 0x1F43B675
# Elements of a segment and of a cluster, by the Matroska specification.
_IN_SEGMENT: Final = frozenset(
    {0x114D9B74, 0x1549A966, 0x1654AE6B, _CLUSTER, 0x1C53BB6B, 0x1941A469, 0x1043A770, 0x1254C367}
    | {0xEC, 0xBF}
)
_IN_CLUSTER: Final = frozenset({0xE7, 0xA3, 0xA0, 0xA7, 0xAB, 0x5854, 0xAF, 0xEC, 0xBF})


def is_video_file(path: Path) -> bool:
    """Whether a file begins as a video does, whatever its name."""
    head = _head(path)
    return (
        head.startswith(_STARTS)
        or head[4:8] in _MP4_BOXES
        or (head[:4] == b"RIFF" and head[8:12] == b"AVI ")
        or _ts_packet(head) is not None
    )


def is_list_of_others(path: Path) -> bool:
    """Whether a file is a text by which FFmpeg would open other files or addresses."""
    return _head(path).lstrip(b"\xef\xbb\xbf \t\r\n").startswith(_LISTS)


def is_mp4(path: Path) -> bool:
    """Whether a file is an MP4 or QuickTime file, which states the number of its frames."""
    return _head(path)[4:8] in _MP4_BOXES


def stated_bytes(path: Path) -> int | None:
    """How long a file must be at least by what its container states; None if it states nothing."""
    head, size = _head(path), path.stat().st_size
    packet = _ts_packet(head)
    if packet is not None:
        return -(-size // packet) * packet
    ends: dict[bool, Callable[[BinaryIO, int], int | None]] = {
        head[4:8] in _MP4_BOXES: _mp4_end,
        head[:4] == b"RIFF": _riff_end,
        head.startswith(_STARTS[0]): _matroska_end,
    }
    if True not in ends:
        return None
    with path.open("rb") as file:
        return ends[True](file, size)


def is_damaged(path: Path) -> bool:
    """Whether packets of a transport stream, or elements of a Matroska file, do not join up."""
    head = _head(path)
    packet = _ts_packet(head)
    if packet is not None:
        offset = dict(_TS_PACKETS)[packet]
        sync = np.memmap(path, np.uint8, "r")[offset::packet]
        return bool((sync != _TS_SYNC).any())
    if not head.startswith(_STARTS[0]):
        return False
    with path.open("rb") as file:
        return _has_wrong_elements(file, path.stat().st_size)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(_HEAD_BYTES)
    except OSError:
        return b""


def _ts_packet(head: bytes) -> int | None:
    """The bytes of a packet of a transport stream; None if the file is none."""
    for packet, offset in _TS_PACKETS:
        sync = head[offset::packet]
        if len(sync) > 1 and set(sync) == {_TS_SYNC}:
            return packet
    return None


def _mp4_end(file: BinaryIO, size: int) -> int | None:
    """The end of the last box."""
    at = 0
    for _ in range(_MOST_BOXES):
        if at >= size:
            return at
        file.seek(at)
        header = file.read(16)
        length, kind = int.from_bytes(header[:4], "big"), header[4:8]
        if length == 1:
            length = int.from_bytes(header[8:16], "big")
        if length < 8 or not kind.isalnum():
            return None  # the rest of the file, or bytes that are no box
        at += length
    return None


def _riff_end(file: BinaryIO, size: int) -> int | None:
    """The end of the last list."""
    at = 0
    while at < size:
        file.seek(at)
        header = file.read(8)
        length = int.from_bytes(header[4:8], "little")
        if header[:4] != b"RIFF" or length < 8:
            break
        at += 8 + length
    return at or None


def _matroska_end(file: BinaryIO, size: int) -> int | None:
    """The end of the segment; None if it was written without a size."""
    return next((end for kind, _, end in _elements(file, 0, size) if kind == _SEGMENT), None)


def _has_wrong_elements(file: BinaryIO, size: int) -> bool:
    for kind, start, end in _elements(file, 0, size):
        if kind != _SEGMENT or end is None:
            continue
        for inner, begin, stop in _elements(file, start, end):
            if inner not in _IN_SEGMENT or stop is None or stop > end:
                return stop is not None or inner not in _IN_SEGMENT
            if inner == _CLUSTER and any(
                each not in _IN_CLUSTER or last is None or last > stop
                for each, _, last in _elements(file, begin, stop)
            ):
                return True
    return False


def _elements(file: BinaryIO, at: int, end: int) -> Iterator[tuple[int, int, int | None]]:
    """The identifier, start of the content and end of each element; the end None if unknown."""
    while at < end:
        file.seek(at)
        header = file.read(12)
        id_bytes = _vint_bytes(header[:1])
        size_bytes = _vint_bytes(header[id_bytes : id_bytes + 1])
        start = at + id_bytes + size_bytes
        kind = int.from_bytes(header[:id_bytes], "big")
        length = int.from_bytes(header[id_bytes : id_bytes + size_bytes], "big")
        ones = (1 << 7 * size_bytes) - 1
        if not (0 < id_bytes <= 4 and size_bytes > 0 and start - at <= len(header)):
            yield 0, at, at
            return
        if length & ones == ones:
            yield kind, start, None
            return
        at = start + (length & ones)
        yield kind, start, at


def _vint_bytes(first: bytes) -> int:
    """Bytes of a number of EBML by its first byte; 0 if it is none."""
    return 9 - first[0].bit_length() if first and first[0] else 0


def incomplete_words(path: Path) -> str | None:
    """How much of the bytes that a file states is missing; None if nothing is."""
    stated, size = stated_bytes(path), os.stat(path).st_size
    if stated is None or stated <= size:
        return None
    return f"it has {size} of the {stated} bytes that it states"
