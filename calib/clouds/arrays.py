"""Point clouds in arrays of numpy (NPZ, NPY), and as bare numbers (KITTI, nuScenes)."""

from __future__ import annotations

import io
import zipfile
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from basetree.arrays import Float
from basetree.files.npy import read_array_header
from calib.clouds.cloud import check_count, xyz_of_records
from calib.errors import CloudError

ZIP: Final = b"PK\x03\x04"
_MOST_AXES: Final = 4
_EXPECTED: Final = "expected an array of Nx3 or more numbers, records with x, y and z, or three"
_MOST_ARRAYS: Final = 1000
_MOST_BYTES_PER_POINT: Final = 64
_KITTI, _NUSCENES = 4, 5  # numbers per point
_FARTHEST_RETURN_M: Final = 2000.0


def read_npy(data: bytes) -> Float:
    """The points of one array: (N, 3 or more) numbers, or records with x, y and z.

    Raises:
        CloudError: If the array has another shape or the file is damaged.
    """
    return _points(_array(io.BytesIO(data), len(data)), "")


def read_npz(data: bytes) -> Float:
    """The points of the arrays of an archive: of one array, or of three called x, y and z.

    Raises:
        CloudError: If no array or several of them may be the points, or the file is damaged.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            arrays = _members(archive)
    except CloudError:
        raise
    except Exception as error:  # zipfile, zlib, lzma and bz2 have their own
        raise CloudError(f"its archive cannot be read ({error})") from error
    by_name = {name.lower(): array for name, array in arrays.items()}
    columns = [by_name.get(name) for name in ("x", "y", "z")]
    if all(column is not None and column.ndim <= 2 for column in columns):
        flat = [np.ravel(column) for column in columns if column is not None]
        if len({len(column) for column in flat}) == 1:
            return _points(np.stack(flat, -1), "x, y and z")
    found = [name for name, array in arrays.items() if _may_be_points(array)]
    if len(found) > 1:
        named = [name for name in found if name.lower() in ("points", "xyz", "cloud", "pcd")]
        found = named if len(named) == 1 else found
    if len(found) != 1:
        shapes = ", ".join(f"{name} {array.shape}" for name, array in list(arrays.items())[:8])
        raise CloudError(f"it holds the arrays {shapes}: {_EXPECTED} called x, y and z")
    return _points(arrays[found[0]], found[0])


def read_numbers(data: bytes, numbers_per_point: int) -> Float:
    """Points of 32-bit numbers, the first three of each point being its coordinates.

    Args:
        data: The file.
        numbers_per_point: 4 as of KITTI (with reflectance), 5 as of nuScenes (and ring).

    Raises:
        CloudError: If the size does not fit, or the values are no coordinates of a scan.
    """
    size = 4 * numbers_per_point
    if not data or len(data) % size:
        raise CloudError(
            f"it has {len(data)} bytes: expected a multiple of {size}, {numbers_per_point} numbers"
            " of 32 bits for each point as in KITTI's scans"
        )
    check_count(len(data) // size)
    points = np.frombuffer(data, "<f4").reshape(-1, numbers_per_point)[:, :3]
    with np.errstate(invalid="ignore"):
        likely = np.abs(points).max(1) < _FARTHEST_RETURN_M
    if np.count_nonzero(likely) < 0.99 * len(points):
        raise CloudError(
            f"{np.count_nonzero(~likely)} of its {len(points)} points are no places within"
            f" {_FARTHEST_RETURN_M:g} m: expected {numbers_per_point} little-endian numbers of 32"
            " bits for each point, as in KITTI's scans"
        )
    return points.astype(np.float64)


def numbers_per_point(name: str) -> int:
    """How many numbers a point of a file of bare numbers has, by the file's name."""
    return _NUSCENES if name.lower().endswith(".pcd.bin") else _KITTI


def _members(archive: zipfile.ZipFile) -> dict[str, NDArray[Any]]:
    entries = [entry for entry in archive.infolist() if entry.filename.endswith(".npy")]
    if not 1 <= len(entries) <= _MOST_ARRAYS:
        raise CloudError(f"its archive holds {len(entries)} arrays: expected some, such as x, y, z")
    check_count(sum(entry.file_size for entry in entries) // _MOST_BYTES_PER_POINT)
    arrays = {}
    for entry in entries:
        with archive.open(entry) as file:
            array = _array(file, entry.file_size)  # type: ignore[arg-type]
        arrays[entry.filename.removesuffix(".npy")] = array
    return arrays


def _array(file: BinaryIO, size: int) -> NDArray[Any]:
    """An array, whose header is compared with the number of bytes that follow."""
    damaged = CloudError("one of its arrays cannot be read: expected numbers as numpy saves them")
    try:
        header = read_array_header(file)
    except ValueError as error:
        raise damaged from error
    if len(header.shape) > _MOST_AXES or header.size_bytes > size:
        raise damaged
    check_count(header.shape[0] if header.shape else 0)
    data = file.read(header.size_bytes)
    if len(data) < header.size_bytes:
        raise damaged
    return header.array(np.frombuffer(data, header.dtype, header.count))


def _may_be_points(array: NDArray[Any]) -> bool:
    names = {name.lower() for name in array.dtype.names or ()}
    is_table = array.ndim in (2, 3) and array.dtype.kind == "f" and 3 <= array.shape[-1] <= 64
    return {"x", "y", "z"} <= names or is_table


def _points(array: NDArray[Any], name: str) -> Float:
    if array.dtype.names:
        return xyz_of_records(array.ravel())
    if not _may_be_points(array):
        raise CloudError(f"its array {name} has shape {array.shape} of {array.dtype}: {_EXPECTED}")
    check_count(array.size // array.shape[-1])
    return array.reshape(-1, array.shape[-1])[:, :3].astype(np.float64)
