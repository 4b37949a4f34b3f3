"""Read panoramas: equirectangular pictures and cube maps."""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import UInt8
from basetree.errors import SettingsError
from perceptree.simulator.photographs.folder import CUBE_FACES, Photograph
from perceptree.simulator.photographs.loading import (
    DEEP,
    MARGIN,
    SEAM,
    blend_seam,
    eight_bit_rgb,
    read_picture,
    reduced,
    seam_ratio,
)

_WIDTH_PX = 2048


def load_panorama(photo: Photograph) -> tuple[UInt8, tuple[str, ...]]:
    """Read a panorama.

    Returns:
        (H, W, 3) uint8 sRGB from zenith to nadir, and what was done to use it.

    Raises:
        SettingsError: If a picture is unreadable, or not twice as wide as high.
    """
    if CUBE_FACES[0] in photo.files:
        return _from_cube(photo), ()
    path = photo.files["color"]
    raw = read_picture(path)
    height, width = raw.shape[:2]
    if abs(width - 2 * height) > 2:
        raise SettingsError(
            f"{path}: is {width}x{height} px, expected a panorama twice as wide as high"
        )
    whole = reduced(eight_bit_rgb(raw), _WIDTH_PX)
    remarks = [] if raw.dtype == np.uint8 else [DEEP]
    if seam_ratio(whole, 1) > 2 * SEAM:
        margin = whole.shape[1] // (4 * MARGIN)
        whole = blend_seam(whole, 1, margin)
        remarks.append("made to wrap around by blending its borders")
    return whole, tuple(remarks)


def _from_cube(photo: Photograph) -> UInt8:
    """Panorama of a cube map, whose faces are seen from inside and lie as in OpenGL."""
    faces = {name: eight_bit_rgb(read_picture(path)) for name, path in photo.files.items()}
    side = faces["posx"].shape[0]
    for name, face in faces.items():
        if face.shape[:2] != (side, side):
            raise SettingsError(
                f"{photo.files[name]}: is {face.shape[1]}x{face.shape[0]} px, expected a square of"
                f" {side} px like the other faces of the cube"
            )
    width = min(4 * side, _WIDTH_PX)
    bearing, climb = np.meshgrid(
        (np.arange(width) + 0.5) * 2 * np.pi / width,
        np.pi / 2 - (np.arange(width // 2) + 0.5) * 2 * np.pi / width,
    )
    x, z = np.sin(bearing) * np.cos(climb), np.cos(bearing) * np.cos(climb)
    y = np.sin(climb)
    views = {"posx": (x, -z, y), "negx": (-x, z, y), "posz": (z, x, y), "negz": (-z, -x, y)}
    views |= {"posy": (y, x, -z), "negy": (-y, x, z)}
    out = np.zeros((*x.shape, 3), np.uint8)
    for name, (depth, right, up) in views.items():
        inside = (depth > 0) & (np.abs(right) <= depth + 1e-9) & (np.abs(up) <= depth + 1e-9)
        safe = np.where(depth > 0, depth, 1)
        column = ((right / safe + 1) * side / 2 - 0.5).astype(np.float32)
        row = ((1 - up / safe) * side / 2 - 0.5).astype(np.float32)
        seen = cv2.remap(
            faces[name], column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        out[inside] = seen[inside]
    return out
