"""Read a point cloud of any format."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Final

from basetree.arrays import Float
from basetree.errors import InputFileError
from basetree.files.limits import current_limits
from basetree.files.npy import NPY_START
from basetree.files.regular import read_regular
from calib.clouds import arrays, las, pcd, ply
from calib.clouds.cloud import PointCloud
from calib.clouds.units import doubted_unit
from calib.errors import CloudError

_log = logging.getLogger(__name__)

CLOUD_SUFFIXES: Final = (".ply", ".pcd", ".las", ".laz", ".npz", ".bin")
_EXPECTED: Final = "expected a point cloud as PLY, PCD, LAS, LAZ, NPZ, NPY or KITTI's BIN"
_MOST_BYTES_PER_POINT: Final = 64


def is_cloud_file(path: Path) -> bool:
    """Whether a path is a file with the suffix of a point cloud."""
    return path.suffix.lower() in CLOUD_SUFFIXES and path.is_file()


def read_cloud(path: Path | str) -> PointCloud:
    """Read a point cloud.

    The format is told by the first bytes; bare numbers, as of KITTI, by the suffix .bin. Of the
    fields of a point only its coordinates are read, in metres. LAS and LAZ need the extra `lidar`.

    Args:
        path: PLY (text or binary), PCD (text, binary or compressed), LAS, LAZ, NPZ, NPY, or BIN
            with four 32-bit numbers for each point; five in nuScenes' .pcd.bin.

    Raises:
        InputFileError: If the file is missing, unreadable or larger than `Limits.cloud_points`
            allows.
        CloudError: If it is damaged or of another format; the message names the file.
        MissingPackage: If a package for its format is not installed.
    """
    path = Path(path)
    try:
        data = read_regular(path, _MOST_BYTES_PER_POINT * current_limits().cloud_points)
    except FileNotFoundError as error:
        raise InputFileError(f"cloud {path}: no such file, {_EXPECTED}") from error
    except OSError as error:
        raise InputFileError(
            f"cloud {path}: cannot be read ({error.strerror}), {_EXPECTED}"
        ) from error
    try:
        cloud = PointCloud(_reader(path, data)(data))
    except CloudError as error:
        raise CloudError(f"cloud {path}: {error}") from error
    if (doubt := doubted_unit(cloud.points_m)) is not None:
        _log.warning("cloud %s: %s", path, doubt)
    return cloud


def _reader(path: Path, data: bytes) -> Callable[[bytes], Float]:
    """The function that reads the points of a file."""
    name = path.name.lower()
    by_start: dict[bytes, Callable[[bytes], Float]] = {
        las.MAGIC: lambda data: las.read_las(data, f"cloud {path}"),
        arrays.ZIP: arrays.read_npz,
        NPY_START: arrays.read_npy,
        ply.MAGIC + b"\n": ply.read_ply,
        ply.MAGIC + b"\r": ply.read_ply,
        **dict.fromkeys(pcd.STARTS, pcd.read_pcd),
    }
    for start, read in by_start.items():
        if data.startswith(start):
            return read
    if name.endswith(".bin"):
        return lambda data: arrays.read_numbers(data, arrays.numbers_per_point(name))
    if name.endswith(".pcd"):
        return pcd.read_pcd  # which may begin with another comment
    raise CloudError(f"it is no point cloud, {_EXPECTED}")
