"""Point clouds in LAS and LAZ files, by `laspy` with `lazrs`, of the extra `lidar`.

laspy and not own code: LAZ is an arithmetic coder with models for each of eleven point formats.
What a header promises is compared with the file before laspy acts on it.
Format: ASPRS, LAS Specification 1.4 - R15.
"""

from __future__ import annotations

import io
import logging
import re
import struct
from typing import Any, Final

import numpy as np

from basetree.arrays import Float
from basetree.errors import MissingPackage, install_hint
from calib.clouds.cloud import check_count
from calib.errors import CloudError

_log = logging.getLogger(__name__)

MAGIC: Final = b"LASF"
_SHORTEST_HEADER: Final = 227
_LONGEST_RECORD: Final = 1024
_COMPRESSED: Final = 0x80
_MOST_VLRS: Final = 10_000
_AT_ONCE: Final = 200_000  # points
_WKT_RECORD: Final = 2112
# Keys of GeoTIFF, and metres per unit by their codes of linear units.
_MODEL_TYPE, _LINEAR_UNIT, _VERTICAL_UNIT, _GEOGRAPHIC = 1024, 3076, 4099, 2
_UNIT_CODES: Final = {9001: 1.0, 9002: 0.3048, 9003: 1200 / 3937}
_UNIT: Final = re.compile(r'unit\["([^"]*)",\s*([0-9]{0,9}\.?[0-9]{0,30}(?:e-?[0-9]{1,2})?)[,\]]')
_ANGLE: Final = re.compile("degree|radian|grad|arc|second")
_UNITS_M: Final = (0.2, 1.0)  # from links to metres
_DEGREES: Final = "its coordinates are degrees: expected metres in a plane"


def read_las(data: bytes, name: str = "the cloud") -> Float:
    """The points of a LAS or LAZ file as (N, 3) coordinates in metres.

    Feet become metres where the file states them, and a line says so.

    Args:
        data: The file.
        name: What the line calls it.

    Raises:
        CloudError: If the file is damaged, or states that its coordinates are degrees.
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
            across, up = _metres_per_unit(file.header.vlrs)
            parts = [_coordinates(points) for points in file.chunk_iterator(_AT_ONCE)]
    except CloudError:
        raise
    except BaseException as error:
        # The decoder panics on damaged data, which is no Exception.
        if isinstance(error, KeyboardInterrupt | SystemExit | MemoryError):
            raise
        words = str(error).split("\n")[0][:200]
        raise CloudError(f"its LAS points cannot be read ({words}): the file is damaged") from error
    points = np.concatenate(parts) if parts else np.zeros((0, 3))
    if across == up == 1:
        return points
    unit = f"{across:.6g} m" if across == up else f"{across:.6g} m across and {up:.6g} m up"
    _log.warning("%s states units of %s: its coordinates are converted to metres", name, unit)
    return points * [across, across, up]


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


def _metres_per_unit(vlrs: Any) -> tuple[float, float]:
    """Metres per unit across and up, as far as the file states its units.

    Raises:
        CloudError: The coordinates are degrees, or in a unit that no survey uses.
    """
    across, up = None, None
    for vlr in vlrs:
        if vlr.record_id == _WKT_RECORD:
            across, up = _units_of_text(str(getattr(vlr, "string", "")).lower())
        for key in getattr(vlr, "geo_keys", ()):
            if key.id == _MODEL_TYPE and key.value_offset == _GEOGRAPHIC:
                raise CloudError(_DEGREES)
            if key.id == _LINEAR_UNIT and across is None:
                across = _UNIT_CODES.get(key.value_offset)
            if key.id == _VERTICAL_UNIT and up is None:
                up = _UNIT_CODES.get(key.value_offset)
    across = 1.0 if across is None else across
    up = across if up is None else up
    for unit in (across, up):
        if not _UNITS_M[0] <= unit <= _UNITS_M[1]:
            raise CloudError(f"its unit is {unit:g} m: expected metres or feet")
    return across, up


def _units_of_text(text: str) -> tuple[float | None, float | None]:
    """Metres per unit across and up by well-known text in lower case; None where it tells none."""
    level, *vertical = re.split(r"vert_?c(?:s|rs)\[", text, maxsplit=1)
    if "geog" in level and "proj" not in level:
        raise CloudError(_DEGREES)
    found = [
        [float(size) for name, size in _UNIT.findall(part) if not _ANGLE.search(name)]
        for part in (level, *vertical)
    ]
    # The unit of a projection stands after those of what it projects.
    across, up = found[0], found[1] if vertical else []
    return across[-1] if across else None, up[-1] if up else None
