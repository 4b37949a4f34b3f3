"""Tell and open captures of phones."""

from __future__ import annotations

from pathlib import Path

from basetree.errors import InputError
from edgetree.frames.rig import Rig
from edgetree.sources.phones.capture import Capture
from edgetree.sources.phones.record3d import is_exr_export, is_record3d, open_record3d
from edgetree.sources.phones.stray import is_stray, open_stray


def is_capture(path: Path) -> bool:
    """Whether a path is a capture of a phone: of Record3D or of Stray Scanner."""
    return is_record3d(path) or (path.is_dir() and (is_stray(path) or is_exr_export(path)))


def open_capture(path: Path, *, rig: Rig | None = None) -> Capture:
    """Open a capture of a phone.

    Args:
        path: An `.r3d` file of Record3D or the folder that it was unpacked to, or a folder of Stray
            Scanner.
        rig: Cameras that take the place of the capture's, and the correction of the depth.

    Returns:
        Its frames, with colour, depth, camera and time, and with pose and gravity as far as they
        are stored. The depth is in the pixels of the picture. Frames that cannot be read are left
        out.

    Raises:
        InputError: It is no such capture, or cannot be read.
        MissingPackage: The package that unpacks the depth of Record3D is not installed.
    """
    if is_record3d(path):
        return open_record3d(path, rig=rig)
    if is_stray(path):
        return open_stray(path, rig=rig)
    if is_exr_export(path):
        raise InputError(
            f"{path} is an export of Record3D with depth as EXR, which is not read: expected the"
            " capture as .r3d, which Record3D exports too"
        )
    raise InputError(
        f"{path} is no capture of a phone: expected an .r3d file of Record3D, or a folder of Stray"
        " Scanner with rgb.mp4, depth and camera_matrix.csv"
    )
