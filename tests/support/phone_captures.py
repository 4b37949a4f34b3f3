"""Captures as Record3D and Stray Scanner write them, of a stem on level ground."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calib import PinholeCamera, RigidTransform, pixels_to_rays

PORTRAIT = PinholeCamera(720, 960, 700.0, 700.0, 361.0, 478.0)
LANDSCAPE = PinholeCamera(1440, 1080, 1050.0, 1050.0, 717.5, 541.0)
RADIUS_M, DISTANCE_M, HEIGHT_M = 0.15, 2.5, 1.4
FRAMES = 3
_Z_DOWN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # to a world with y up


def mounting(number: int, quarter_turns: int = 0) -> RigidTransform:
    """Camera to a level frame (x forward, y left, z up); it moves 1 cm aside in each frame."""
    level = RigidTransform.mounting([0.0, 0.01 * number, HEIGHT_M], roll_deg=3.0, pitch_deg=12.0)
    turn = np.linalg.matrix_power(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]), quarter_turns)
    return RigidTransform(level.rotation @ turn, level.translation_m)


def cast(camera: PinholeCamera, pose: RigidTransform) -> tuple[np.ndarray, np.ndarray]:
    """(H, W) depth in metres of ground and stem, and whether a pixel shows the stem."""
    rows, columns = np.mgrid[: camera.height, : camera.width]
    rays = pose.rotate(pixels_to_rays(camera, np.stack([columns, rows], -1) + 0.5))
    start = pose.translation_m
    with np.errstate(divide="ignore", invalid="ignore"):
        ground_m = np.where(rays[..., 2] < 0, -start[2] / rays[..., 2], np.inf)
        off = start[:2] - [DISTANCE_M, 0.0]
        a, b = (rays[..., :2] ** 2).sum(-1), rays[..., :2] @ off
        root = b**2 - a * (off @ off - RADIUS_M**2)
        stem_m = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    stem_m[(start[2] + stem_m * rays[..., 2] < 0) | (stem_m < 0)] = np.inf
    depth_m = np.minimum(ground_m, stem_m)
    return np.where(depth_m < 5.0, depth_m, 0.0), (stem_m < ground_m) & (stem_m < 5.0)


def picture(camera: PinholeCamera, pose: RigidTransform) -> np.ndarray:
    """(H, W, 3) BGR, the stem darker than the ground."""
    stem = cast(camera, pose)[1]
    return np.repeat(np.where(stem, 60, 170).astype(np.uint8)[..., None], 3, axis=2)


def quaternion(rotation: np.ndarray) -> list[float]:
    """x, y, z, w of a rotation of less than 180 degrees."""
    w = np.sqrt(max(1 + np.trace(rotation), 1e-12)) / 2
    x, y, z = (rotation[i, j] - rotation[j, i] for i, j in ((2, 1), (0, 2), (1, 0)))
    return [x / 4 / w, y / 4 / w, z / 4 / w, float(w)]


def arkit_pose(pose: RigidTransform, axes: np.ndarray) -> list[float]:
    """Quaternion and place in ARKit's world, of a camera with other axes than ours."""
    rotation = _Z_DOWN @ pose.rotation @ axes
    return [*quaternion(rotation), *(_Z_DOWN @ pose.translation_m).tolist()]


def relative(pose: list[float], start: list[float]) -> list[float]:
    """A pose in the axes of the first camera."""
    first = RigidTransform.from_quaternion(start[:4], start[4:])
    found = RigidTransform.from_quaternion(pose[:4], pose[4:]).then(first.inverse())
    return [*quaternion(found.rotation), *found.translation_m.tolist()]


def record3d_files(
    camera: PinholeCamera = PORTRAIT,
    *,
    poses: str = "world",
    frames: int = FRAMES,
    depth_px: tuple[int, int] = (192, 256),
    **changed: Any,
) -> dict[str, bytes]:
    """The files in an `.r3d` file by their names.

    Args:
        camera: Of the pictures.
        poses: "world", "relative" with initPose, "unknown" without, or "none".
        frames: Number of frames.
        depth_px: Width and height of the depth.
        changed: Values of the metadata that differ.
    """
    lzfse = __import__("lzfse")
    small = camera.scaled(*depth_px)
    opengl = np.diag([1.0, -1.0, -1.0])
    world = [arkit_pose(mounting(number), opengl) for number in range(frames)]
    identity = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    stored = world if poses == "world" else [relative(pose, world[0]) for pose in world]
    values: dict[str, Any] = {
        "w": camera.width,
        "h": camera.height,
        "K": [camera.fx, 0, 0, 0, camera.fy, 0, camera.cx, camera.cy, 1],
        "fps": 30,
        "dw": small.width,
        "dh": small.height,
        "initPose": world[0] if poses == "relative" else identity,
        "poses": [identity] * frames if poses == "none" else stored,
        "frameTimestamps": [0.5 + number / 30 for number in range(frames)],
        "perFrameIntrinsicCoeffs": [[camera.fx, camera.fy, camera.cx, camera.cy]] * frames,
        "cameraType": 1,
    }
    values |= changed
    values = {name: value for name, value in values.items() if value is not None}
    files = {"metadata": json.dumps(values).encode()}
    for number in range(frames):
        pose = mounting(number)
        depth_m = cast(small, pose)[0]
        confidence = np.where(depth_m > 0, 2, 0).astype(np.uint8)
        depth_m[depth_m == 0] = np.nan
        name = f"rgbd/{number}"
        jpeg = cv2.imencode(".jpg", picture(camera, pose))[1].tobytes()
        files[f"{name}.jpg"] = jpeg
        files[f"{name}.depth"] = lzfse.compress(depth_m.astype("<f4").tobytes())
        files[f"{name}.conf"] = lzfse.compress(confidence.tobytes())
    return files


def zipped(files: dict[str, bytes]) -> bytes:
    """A zip file of these."""
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return buffer.getvalue()


def write_stray(
    folder: Path,
    camera: PinholeCamera = LANDSCAPE,
    *,
    frames: int = FRAMES,
    quarter_turns: int = 0,
    header: bool = True,
) -> Path:
    """Write a capture of Stray Scanner.

    Args:
        folder: The folder to make.
        camera: Of the pictures.
        frames: Number of frames.
        quarter_turns: By which the pictures must be turned clockwise to be upright.
        header: Whether odometry.csv has a header, time stamps and numbers.
    """
    (folder / "depth").mkdir(parents=True)
    (folder / "confidence").mkdir()
    small = camera.scaled(256, 192)
    size = (camera.width, camera.height)
    fourcc = cv2.VideoWriter.fourcc(*"mp4v")
    writer = cv2.VideoWriter(str(folder / "rgb.mp4"), fourcc, 30.0, size)
    rows = ["timestamp, frame, x, y, z, qx, qy, qz, qw"] if header else []
    for number in range(frames):
        pose = mounting(number, quarter_turns)
        depth_m = cast(small, pose)[0]
        mm = np.rint(1000 * depth_m).astype(np.uint16)
        cv2.imwrite(str(folder / "depth" / f"{number:06d}.png"), mm)
        confidence = np.where(mm > 0, 2, 0).astype(np.uint8)
        cv2.imwrite(str(folder / "confidence" / f"{number:06d}.png"), confidence)
        writer.write(picture(camera, pose))
        found = arkit_pose(pose, np.eye(3))
        values = [*found[4:], *found[:4]]
        values = [100.0 + number / 30, f"{number:06d}", *values] if header else values
        rows.append(", ".join(map(str, values)))
    writer.release()
    (folder / "odometry.csv").write_text("\n".join(rows))
    matrix = [[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]]
    text = "\n".join(", ".join(map(str, row)) for row in matrix)
    (folder / "camera_matrix.csv").write_text(text)
    (folder / "imu.csv").write_text(
        "timestamp, a_x, a_y, a_z, alpha_x, alpha_y, alpha_z\n100.0, 0.0, -1.0, 0.1, 0, 0, 0\n"
    )
    return folder
