"""One picture with all that its source knows about it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform

_LEAST_LEVEL_PART: Final = 0.1
_LARGEST_TIME_S: Final = 1e11  # three thousand years: milliseconds since 1970 are more


@dataclass(frozen=True)
class DepthNoise:
    """What a source knows of the errors of its depth, in place of the measurement's assumptions.

    What is None stays assumed; `edgetree.measure.MeasureSettings` says what each means.

    Attributes:
        noise_per_m: Standard deviation of the depth at 1 m, in metres; at z metres it is z² times
            as large.
        noise_m: Smallest standard deviation, in metres.
        bias_per_m: Error at 1 m that the readings on one stem share, in metres, times z².
        correlation_px: Side of the squares of the picture in which readings share one error.
    """

    noise_per_m: float | None = None
    noise_m: float | None = None
    bias_per_m: float | None = None
    correlation_px: float | None = None


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a source.

    Attributes:
        name: The file's stem, for videos and recordings with the frame's number; valid as a file
            name.
        path: The file or recording of the frame; None of a camera.
        image: (H, W, 3) uint8 BGR; None if there is only depth.
        depth_m: (H, W) float32 metres along the optical axis, 0.0 = no reading, aligned with the
            image; None if there is only colour.
        depth_fault: Why the depth is unusable; None if it is usable.
        time_s: Time stamp of the picture in the clock of the source, s, such as its position in a
            video; None of an image file.
        number: Number of the frame in a stream, from 0 on; numbers of left-out frames are missing.
            None of an image file.
        camera: Intrinsics of the image; None if the source does not know them.
        up_camera: (3,) unit vector away from gravity in the camera's frame; None if unknown.
        pose: Transform from the camera's frame to a fixed frame (x and y level, z up), as from the
            machine's odometry; None if unknown.
        depth_noise: Errors of the depth, as far as the source knows them; None if it does not.
        filled_depth_m: (H, W) depth of which the gaps between beams are closed, which networks see
            in place of `depth_m`; None if `depth_m` is not that of single beams of a scanner.
        cloud_m: (N, 3) points of a cloud in the camera's frame, which may show stems from all
            sides; None if the depth is all that is known.
        exif_focal_px: Focal length in px that the picture's EXIF states; None if it states none.
        depth_is_moved: Whether the depth was moved into the pixels of the image from another
            camera's, lens and all.
        rotation_deg: Degrees by which the picture must be turned clockwise to be upright, as a
            recording says it; None if the vertical tells.
    """

    name: str
    path: Path | None
    image: NDArray[np.uint8] | None
    depth_m: NDArray[np.float32] | None = None
    depth_fault: str | None = None
    time_s: float | None = None
    number: int | None = None
    camera: PinholeCamera | None = None
    up_camera: NDArray[np.float64] | None = None
    pose: RigidTransform | None = None
    depth_noise: DepthNoise | None = None
    filled_depth_m: NDArray[np.float32] | None = None
    exif_focal_px: float | None = None
    rotation_deg: int | None = None
    cloud_m: NDArray[np.float64] | None = None
    depth_is_moved: bool = False

    def __post_init__(self) -> None:
        if self.time_s is not None and not abs(self.time_s) <= _LARGEST_TIME_S:
            raise InputError(
                f"time_s of {self.where} is {self.time_s:g}: expected seconds, not more than"
                f" {_LARGEST_TIME_S:g}"
            )

    def picture(self) -> NDArray[np.uint8]:
        """The image, (H, W, 3) BGR; raises InputError if the frame has depth alone."""
        if self.image is None:
            raise InputError(f"{self.where} is a depth image: expected a picture of 8 bits")
        return self.image

    @property
    def where(self) -> str:
        """What messages call the frame: its file, or its name if it has none."""
        return self.name if self.path is None else str(self.path)

    @property
    def stamp_s(self) -> float:
        """The time stamp, s.

        Raises:
            InputError: The frame has none.
        """
        if self.time_s is None:
            raise InputError(f"frame {self.where} has no time stamp: expected a frame of a stream")
        return self.time_s


def stream_frame(
    number: int,
    time_s: float,
    image: NDArray[np.uint8] | None,
    depth_m: NDArray[np.float32] | None = None,
    camera: PinholeCamera | None = None,
    up_camera: NDArray[np.float64] | None = None,
    pose: RigidTransform | None = None,
    depth_fault: str | None = None,
) -> Frame:
    """Make a frame of a stream, such as of a camera, which is named by its number.

    Args:
        number: As in `Frame`, and so are the others.
        time_s: Time stamp, s.
        image: (H, W, 3) uint8 BGR.
        depth_m: (H, W) float32 metres.
        camera: Intrinsics of the image.
        up_camera: (3,) unit vector away from gravity.
        pose: Transform from the camera's frame to a fixed frame.
        depth_fault: Why the depth is unusable.
    """
    name = f"frame_{number:06d}"
    more = (number, camera, up_camera, pose)
    return Frame(name, None, image, depth_m, depth_fault, time_s, *more)


def level_axes(up_camera: NDArray[np.floating[Any]] | None) -> NDArray[np.float64]:
    """Unit vectors to the right, ahead and up, in the camera's frame.

    Args:
        up_camera: (3,) unit vector away from gravity in the camera's frame; None if level.

    Returns:
        (3, 3), one direction in each row. For a camera that looks straight up or down, ahead is the
        top of the image.
    """
    up = np.array([0.0, -1.0, 0.0]) if up_camera is None else np.asarray(up_camera, np.float64)
    forward, image_up = np.array([0.0, 0.0, 1.0]), np.array([0.0, -1.0, 0.0])
    ahead = forward - (forward @ up) * up
    if np.linalg.norm(ahead) < _LEAST_LEVEL_PART:
        ahead = image_up - (image_up @ up) * up
    ahead /= np.linalg.norm(ahead)
    return np.stack([np.cross(ahead, up), ahead, up])
