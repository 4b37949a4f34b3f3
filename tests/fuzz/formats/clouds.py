"""Point clouds."""

from __future__ import annotations

import io
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "support"))
from cloud_files import (
    PLY_TEXT,
    kitti,
    las,
    npy,
    npz,
    pcd_binary,
    pcd_compressed,
    pcd_text,
    ply_binary,
)

from calib.clouds import read_cloud
from formats.form import Format


def _las() -> tuple[bytes, ...]:
    """LAS, and LAZ where the package for it is installed."""
    try:
        import laspy
    except ImportError:
        return ()
    packed = io.BytesIO()
    laspy.read(io.BytesIO(las())).write(packed, do_compress=True)
    return las(), las(feet=True), packed.getvalue()


FORMATS = {
    "cloud.ply": Format((PLY_TEXT, ply_binary("<"), ply_binary(">")), read_cloud),
    "cloud.pcd": Format((pcd_text(), pcd_binary(), pcd_compressed()), read_cloud),
    "cloud.bin": Format((kitti(),), read_cloud),
    "cloud.npz": Format((npz(), npz(("points",)), npy()), read_cloud),
    **({"cloud.las": Format(_las(), read_cloud)} if _las() else {}),
}
