"""Point clouds in LAS and LAZ files, by `laspy` with `lazrs`, of the extra `lidar`.

laspy and not own code: LAZ is an arithmetic coder with models for each of eleven point formats.
What a header promises is compared with the file before laspy acts on it.
Format: ASPRS, LAS Specification 1.4 - R15.
"""

from __future__ import annotations

import io
import struct
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from basetree.errors import MissingPackage, install_hint
from calib.clouds.cloud import check_count
from calib.errors import CloudError

MAGIC: Final = b"LASF"
_SHORTEST_HEADER: Final = 227
_LONGEST_RECORD: Final = 1024
_COMPRESSED: Final = 0x80
_MOST_VLRS: Final = 10_000
_AT_ONCE: Final = 200_000  # points
_FEET: Final = (9002, 9003)  # codes of linear units in the tags of GeoTIFF
_LINEAR_UNIT: Final = 3076


def read_las(data: bytes) -> Float:
    """The points of a LAS or LAZ file as (N, 3) coordinates.

    Raises:
        CloudError: If the file is damaged, or states that its coordinates are feet or degrees.
        MissingPackage: If `laspy` or `lazrs` is not installed.
    """
    _check_header(data)
    try:
        import laspy
        import lazrs  # noqa: F401 - laspy looks for it when it opens a compressed file
    except ImportError as error:
        raise MissingPackage(f"LAS and LAZ files need laspy: {install_hint('lidar')}") from error
    try:
        # The parallel decoder takes memory for what a damaged table of chunks promises.
        decoder = laspy.LazBackend.Lazrs
        with laspy.open(io.BytesIO(data), closefd=False, laz_backend=decoder) as file:
            _check_unit(file.header.vlrs)
            parts = [_coordinates(points) for points in file.chunk_iterator(_AT_ONCE)]
    except CloudError:
        raise
    except BaseException as error:
        # The decoder panics on damaged data, which is no Exception.
        if isinstance(error, KeyboardInterrupt | SystemExit | MemoryError):
            raise
        words = str(error).split("\n")[0][:200]
        raise CloudError(f"its LAS points cannot be read ({words}): the file is damaged") from error
    return np.concatenate(parts) if parts else np.zeros((0, 3))


def _coordinates(points: Any) -> Float:
    return np.stack([np.asarray(points[axis], np.float64) for axis in ("x", "y", "z")], -1)


def _check_header(data: bytes) -> None:
    """Compare what the header promises with the file and the limits."""
    if len(data) < _SHORTEST_HEADER:
        raise CloudError(f"it has {len(data)} bytes: expected a LAS header of {_SHORTEST_HEADER}")
    minor, kind = data[25], data[104]
    header, offset, vlrs = struct.unpack_from("<HII", data, 94)
    length, count = struct.unpack_from("<HI", data, 105)
    if minor >= 4 and len(data) >= 375:
        count = max(count, *struct.unpack_from("<Q", data, 247))
    check_count(count)
    if not header <= offset <= len(data) or not 20 <= length <= _LONGEST_RECORD:
        raise CloudError(
            f"its LAS header states records of {length} bytes from byte {offset} of {len(data)} on:"
            " the file is damaged or not complete"
        )
    if vlrs > min(_MOST_VLRS, len(data) // 54):
        raise CloudError(f"its LAS header states {vlrs} records of variable length: damaged")
    if kind & _COMPRESSED:
        _check_chunks(data, offset, count)
    elif count * length > len(data) - offset:
        there = (len(data) - offset) // length
        raise CloudError(f"it ends after {there} of {count} points: expected all")


def _check_chunks(data: bytes, offset: int, count: int) -> None:
    """Compare the number of chunks that compressed points state with their file."""
    table = struct.unpack_from("<q", data, offset)[0] if offset + 8 <= len(data) else -1
    if table == -1:  # at the end, of a file that was written as a stream
        table = struct.unpack_from("<q", data, len(data) - 8)[0]
    if not offset + 8 <= table <= len(data) - 8:
        raise CloudError("its table of compressed chunks is missing: damaged or not complete")
    version, chunks = struct.unpack_from("<II", data, table)
    if version or chunks > min(count, len(data) // 8):
        raise CloudError(f"it states {chunks} chunks of {count} points: the file is damaged")


def _check_unit(vlrs: Any) -> None:
    """Refuse coordinates in feet or degrees, as far as the file states its unit."""
    for vlr in vlrs:
        if vlr.record_id == 2112:
            text = str(getattr(vlr, "string", "")).lower()
            if text.startswith("geogcs"):
                raise CloudError("its coordinates are degrees: expected metres in a plane")
            if "foot" in text.split("vert_cs")[0]:
                raise CloudError("its coordinates are feet: expected metres")
        for key in getattr(vlr, "geo_keys", ()):
            if key.id == _LINEAR_UNIT and key.value_offset in _FEET:
                raise CloudError("its coordinates are feet: expected metres")
