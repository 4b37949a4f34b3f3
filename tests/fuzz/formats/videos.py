"""Videos, and what their containers state."""

from __future__ import annotations

import struct
from pathlib import Path

import cv2
import numpy as np

from edgetree.sources import open_source
from edgetree.sources.video_files import is_damaged, is_video_file, stated_bytes
from formats.form import Format

_FRAMES = [
    cv2.imencode(".jpg", np.full((16, 16, 3), 80 * number, np.uint8))[1].tobytes()
    for number in range(3)
]


def _chunk(name: bytes, content: bytes) -> bytes:
    return name + struct.pack("<I", len(content)) + content + bytes(len(content) % 2)


def _avi() -> bytes:
    main = struct.pack("<14I", 100_000, 0, 0, 0, 3, 0, 1, 0, 16, 16, 0, 0, 0, 0)
    rate = struct.pack("<IHHIIIIIIII4H", 0, 0, 0, 0, 1, 10, 0, 3, 0, 0, 0, 0, 0, 16, 16)
    picture = struct.pack("<IiiHH4sIiiII", 40, 16, 16, 1, 24, b"MJPG", 768, 0, 0, 0, 0)
    stream = _chunk(b"strh", b"vidsMJPG" + rate) + _chunk(b"strf", picture)
    header = b"hdrl" + _chunk(b"avih", main) + _chunk(b"LIST", b"strl" + stream)
    frames = b"movi" + b"".join(_chunk(b"00dc", frame) for frame in _FRAMES)
    return _chunk(b"RIFF", b"AVI " + _chunk(b"LIST", header) + _chunk(b"LIST", frames))


def _element(kind: str, content: bytes) -> bytes:
    return bytes.fromhex(kind) + struct.pack(">Q", len(content) | 1 << 56) + content


def _matroska() -> bytes:
    video = _element("B0", b"\x10") + _element("BA", b"\x10")
    track = _element("D7", b"\1") + _element("73C5", b"\1") + _element("83", b"\1")
    track += _element("86", b"V_MJPEG") + _element("E0", video)
    info = _element("2AD7B1", struct.pack(">I", 1_000_000)) + _element(
        "4489", struct.pack(">d", 300)
    )
    blocks = b"".join(
        _element("A3", b"\x81" + struct.pack(">hB", 100 * number, 0x80) + frame)
        for number, frame in enumerate(_FRAMES)
    )
    cluster = _element("1F43B675", _element("E7", b"\0") + blocks)
    tracks = _element("1654AE6B", _element("AE", track))
    segment = _element("1549A966", info) + tracks + cluster
    return _element("1A45DFA3", _element("4282", b"matroska")) + _element("18538067", segment)


_MP4 = b"\0\0\0\x10ftypisom\0\0\0\0" + b"\0\0\0\x01mdat" + struct.pack(">Q", 20) + bytes(4)
_TS = (b"G" + bytes(187)) * 3


def _container(path: Path) -> object:
    return is_video_file(path), stated_bytes(path), is_damaged(path)


def _frames(path: Path) -> object:
    return list(open_source(path))


FORMATS = {
    "container": Format((_avi(), _matroska(), _MP4, _TS), _container),
    "video": Format((_avi(), _matroska()), _frames),
}
