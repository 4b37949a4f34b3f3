"""Point clouds as other programs write them, built byte by byte from the formats' documentation."""

from __future__ import annotations

import io
import struct
import zipfile

import numpy as np

POINTS = np.array([[1.5, -2.0, 0.25], [4.0, 5.5, -0.5], [7.0, 0.125, 3.0]])
"""Every number is exact in 32 bits, and a multiple of 1 mm but for 1/8 and 1/4, which are too."""

PLY_TEXT = b"""ply
format ascii 1.0
comment made by CloudCompare
element vertex 3
property float x
property float y
property float z
property uchar red
element face 1
property list uchar int vertex_indices
end_header
1.5 -2.0 0.25 10
4 5.5 -0.5 20
7e0 0.125 3.0 30
3 0 1 2
"""

_PLY_HEAD = """ply\r
format {} 1.0\r
element camera 1\r
property float focal\r
element vertex 3\r
property double x\r
property double y\r
property double z\r
property uchar intensity\r
end_header\r
"""
_PCD_HEAD = """# .PCD v0.7 - Point Cloud Data file format
VERSION 0.7
FIELDS x y z _ intensity
SIZE 4 4 4 1 4
TYPE F F F U F
COUNT 1 1 1 4 1
WIDTH 3
HEIGHT 1
VIEWPOINT 0 0 0 1 0 0 0
POINTS 3
DATA {}
"""


def ply_binary(order: str) -> bytes:
    """A binary PLY with an element before the vertices; `order` is < or >."""
    name = {"<": "binary_little_endian", ">": "binary_big_endian"}[order]
    rows = [struct.pack(order + "dddB", *point, 7) for point in POINTS]
    return _PLY_HEAD.format(name).encode() + struct.pack(order + "f", 500.0) + b"".join(rows)


def pcd_text() -> bytes:
    """A PCD in text, with a missing return."""
    rows = "".join(f"{x} {y} {z} 0 0 0 0 9\n" for x, y, z in POINTS.tolist()[:2])
    return (_PCD_HEAD.format("ascii") + rows + "nan nan nan 0 0 0 0 0\n").encode()


def pcd_binary() -> bytes:
    """A binary PCD, with padding between the fields."""
    rows = [struct.pack("<fff4Bf", *point, 0, 0, 0, 0, 9.0) for point in POINTS]
    return _PCD_HEAD.format("binary").encode() + b"".join(rows)


def pcd_compressed() -> bytes:
    """A compressed PCD: fields one after the other; padding and intensity are repeated bytes."""
    columns = b"".join(struct.pack("<3f", *POINTS[:, axis]) for axis in range(3))
    literals = b"".join(
        bytes([len(part) - 1]) + part for part in (columns[:32], columns[32:] + b"\0")
    )
    # 11 more zeros by the long form (7 + 2 + 2), and 12 by another one, each from the byte before.
    repeats = bytes([7 << 5, 2, 0]) + bytes([7 << 5, 3, 0])
    packed = literals + repeats
    return _PCD_HEAD.format("binary_compressed").encode() + (
        struct.pack("<II", len(packed), 3 * 20) + packed
    )


def las(feet: bool = False) -> bytes:
    """A LAS 1.2 file of point format 0, with scale 0.001 and a large offset."""
    offset = (500_000.0, 6_000_000.0, 0.0)
    keys = struct.pack("<HHHH" + "HHHH", 1, 1, 0, 1, 3076, 0, 1, 9003)
    vlr = b"\0\0" + b"LASF_Projection".ljust(16, b"\0") + struct.pack("<HH", 34735, len(keys))
    vlr += b"units".ljust(32, b"\0") + keys
    vlr = vlr if feet else b""
    low, high = POINTS.min(0) + offset, POINTS.max(0) + offset
    head = b"LASF" + bytes(4) + bytes(16) + bytes([1, 2]) + b"OTHER".ljust(32, b"\0")
    head += b"a scanner".ljust(32, b"\0") + struct.pack("<HH", 100, 2024)
    head += struct.pack("<HIIBHI", 227, 227 + len(vlr), int(feet), 0, 20, 3)
    head += struct.pack("<5I", 3, 0, 0, 0, 0) + struct.pack("<3d", 0.001, 0.001, 0.001)
    head += struct.pack("<3d", *offset)
    head += b"".join(struct.pack("<dd", *pair) for pair in zip(high, low, strict=True))
    rows = [
        struct.pack("<iiiHBBbBH", *(round(v * 1000) for v in point), 50, 0x11, 2, 0, 0, 1)
        for point in POINTS.tolist()
    ]
    return head + vlr + b"".join(rows)


def kitti(numbers: int = 4) -> bytes:
    """A scan of KITTI, or of nuScenes with five numbers for each point."""
    return b"".join(struct.pack(f"<{numbers}f", *point, *range(numbers - 3)) for point in POINTS)


def npy(shape: str = "(3, 3)", kind: str = "<f8", values: np.ndarray = POINTS) -> bytes:
    """A .npy file of version 1.0."""
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".encode()
    header = header.ljust(117) + b"\n"
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + values.tobytes()


def npz(names: tuple[str, ...] = ("x", "y", "z")) -> bytes:
    """An archive of one array for each coordinate, or of one for all."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        if len(names) == 1:
            archive.writestr(f"{names[0]}.npy", npy())
        else:
            for name, column in zip(names, POINTS.T.copy(), strict=True):
                archive.writestr(f"{name}.npy", npy("(3,)", values=column))
    return file.getvalue()
