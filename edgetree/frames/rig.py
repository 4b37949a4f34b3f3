"""The cameras: image camera, depth camera, and their mounting."""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

import calib
from basetree.errors import InputError
from basetree.files.reading import orientation_note
from calib.clouds import PointCloud, depth_of_beams, fill_between, read_cloud
from calib.depth.convention import check_kind, check_scale
from edgetree.frames.frame import Frame
from edgetree.frames.turning import Turn, check_rotation, turn_of

if TYPE_CHECKING:
    from edgetree.frames.references import SizeReferences
    from edgetree.measure import RigUncertainty

_log = logging.getLogger(__name__)

# Cosine of the angle, 1 degree, from which two verticals differ.
_SAME_VERTICAL = 0.99985


class DepthReading(NamedTuple):
    """Depth in metres.

    Attributes:
        depth_m: (H, W) float32 metres, 0.0 = no reading.
        fault: Why the depth is unusable; None if it is usable.
    """

    depth_m: NDArray[np.float32]
    fault: str | None


class BeamReading(NamedTuple):
    """Depth of a scanner's beams in metres.

    Attributes:
        depth_m: (H, W) float32 metres, 0.0 = no beam.
        filled_m: (H, W) the same with the gaps between neighbouring beams closed.
    """

    depth_m: NDArray[np.float32]
    filled_m: NDArray[np.float32]

    @classmethod
    def of_cloud(
        cls, cloud: PointCloud, camera: calib.PinholeCamera, to_camera: calib.RigidTransform
    ) -> BeamReading:
        """The beams of a cloud in a picture.

        Raises:
            CloudError: As `depth_of_beams`.
        """
        beams = depth_of_beams(cloud, camera, to_camera)
        return cls(beams.depth_m, fill_between(beams.depth_m, beams.spacing))


@dataclass(frozen=True, eq=False)
class Rig:
    """The cameras that took the frames, as far as they are known.

    Attributes:
        camera: The image camera; without it nothing can be measured.
        up_camera: Direction opposite to gravity in the camera's frame, as from an IMU.
        mounting: Transform from the camera's frame to the machine's (x forward, y left, z up).
        depth_camera: The depth camera; None if depth files are aligned with the images.
        depth_extrinsics: Transform from the depth camera's frame to the image camera's; None for
            the identity.
        cloud_extrinsics: Transform from the scanner's frame, that of point clouds, to the image
            camera's.
        depth_scale_m: Metres per unit of the depth. None: integers are millimetres, floating point
            is metres.
        depth_calibration: Correction of the depth; None for no correction.
        depth_kind: "depth" along the optical axis, or "range" along the ray of each pixel.
        rotation_deg: Degrees, 90, 180 or 270, by which pictures must be turned clockwise to be
            upright; None: a camera on its side is told by its vertical. All else is that of the
            camera as it is mounted, and so are results.
        uncertainty: How well all this is known; what it does not state is assumed.
        references: What tells sizes in pictures without depth; None for nothing.

    Raises:
        InputError: A value is out of its range, or needs another one that is missing.
    """

    camera: calib.PinholeCamera | None = None
    up_camera: tuple[float, float, float] | None = None
    mounting: calib.RigidTransform | None = None
    depth_camera: calib.PinholeCamera | None = None
    depth_extrinsics: calib.RigidTransform | None = None
    cloud_extrinsics: calib.RigidTransform | None = None
    depth_scale_m: float | None = None
    depth_calibration: calib.DepthScale | None = None
    depth_kind: calib.DepthKind = "depth"
    rotation_deg: int | None = None
    uncertainty: RigUncertainty | None = None
    references: SizeReferences | None = None

    def __post_init__(self) -> None:
        check_scale(self.depth_scale_m, "--depth-scale")
        check_kind(self.depth_kind, "--depth-kind")
        check_rotation(self.rotation_deg, "--rotate")
        if self.depth_camera is not None and self.camera is None:
            raise InputError(
                "--depth-camera given without --camera: expected both, to align depth and image"
            )
        if self.cloud_extrinsics is not None and self.camera is None:
            raise InputError("--extrinsic given without --camera: expected both, to project clouds")
        if self.depth_extrinsics is not None and self.depth_camera is None:
            raise InputError("--depth-extrinsics given without --depth-camera: expected both")

    def turn(self, frame: Frame) -> Turn:
        """The turn that makes a frame upright."""
        up_camera = self.up_camera if frame.up_camera is None else frame.up_camera
        if up_camera is None and self.mounting is not None:
            up_camera = self.mounting.rotation[2]  # of a machine that stands level
        return turn_of(self.rotation_of(frame), up_camera)

    def rotation_of(self, frame: Frame) -> int | None:
        """The given rotation, or that of the frame, in degrees; None if the vertical tells."""
        return frame.rotation_deg if self.rotation_deg is None else self.rotation_deg

    @property
    def depth_convention(self) -> calib.DepthConvention:
        """Unit, kind and correction of the depth."""
        return calib.DepthConvention(self.depth_scale_m, self.depth_kind, self.depth_calibration)

    def camera_for(self, width: int, height: int) -> calib.PinholeCamera | None:
        """The image camera, scaled to images of this size; None if it is not known.

        Args:
            width: Width of the image in pixels.
            height: Height of the image in pixels.

        Raises:
            CameraError: The camera is for another aspect ratio.
        """
        return None if self.camera is None else _of_size(self.camera, width, height)

    def tell_depth(self) -> None:
        """Say once that given references are not used for frames with depth, if there are any."""
        if self.references is not None and self.references.give_distances:
            _tell_own(
                "depth, by which they are measured", "--camera-height, --marker or --scale-bar"
            )

    def tell_lens(self, frame: Frame) -> None:
        """Warn, once for a camera, if its lens bends the pixels in which the depth is given.

        Depth of another camera or of beams is moved into these pixels, and needs no warning.
        """
        is_moved = frame.depth_is_moved or frame.filled_depth_m is not None
        if frame.depth_m is None or is_moved or self.depth_camera is not None:
            return
        if self.camera is not None and self.camera.distortion:
            _warn_of_lens(self.camera)

    def known_uncertainty(self) -> RigUncertainty:
        """What is stated of the rig's errors; that of a depth scale comes with its calibration."""
        from edgetree.measure import RigUncertainty

        stated = self.uncertainty or RigUncertainty()
        if stated.depth_scale_std is not None or self.depth_calibration is None:
            return stated
        return replace(stated, depth_scale_std=min(self.depth_calibration.std_share, 0.5))

    def vertical_of(
        self, frame: Frame, camera: calib.PinholeCamera | None
    ) -> NDArray[np.float64] | None:
        """(3,) the vertical of a frame: its own, or that given, or by a given horizon."""
        up_camera = self._known_vertical(frame)
        if up_camera is not None:
            return up_camera
        if self.references is None or camera is None:
            return None
        try:
            return self.references.up_camera(camera, self.turn(frame))
        except InputError as error:
            raise InputError(f"{frame.where}: {error}") from error

    def _known_vertical(self, frame: Frame) -> NDArray[np.float64] | None:
        """(3,) the vertical of a frame: its own, or else the given one.

        If both are there and differ, a line says once that the given one is not used.
        """
        given = None if self.up_camera is None else unit_vector(self.up_camera)
        if frame.up_camera is None:
            return given
        if given is not None and given @ frame.up_camera < _SAME_VERTICAL:
            _tell_own("a vertical, by which they are measured", "--up or --pitch")
        return frame.up_camera

    def tell_assumed(
        self, camera: calib.PinholeCamera, has_vertical: bool, *, has_depth: bool = True
    ) -> None:
        """Say, once for each set of values, which errors of the rig nothing states.

        Args:
            camera: The camera of the measurement.
            has_vertical: Whether a vertical is given.
            has_depth: Whether the measurement uses depth.
        """
        has_mounting = self.mounting is not None
        stated = self.known_uncertainty()
        if not has_depth:
            stated = replace(stated, depth_scale_std=0.0)
        _tell_assumed(*stated.assumed(camera, has_vertical or has_mounting, has_mounting))

    def completed(self, frame: Frame, width: int, height: int) -> Frame:
        """The frame with camera, vertical and rotation as it is measured.

        A given camera takes the place of the frame's own. A vertical of the frame goes before a
        given one, as it is of that moment.

        Args:
            frame: The frame.
            width: Its width in pixels.
            height: Its height in pixels.

        Raises:
            CameraError: The camera is for another aspect ratio.
        """
        up_camera = self._known_vertical(frame)
        camera = self.camera_for(width, height) or frame.camera
        self.tell_lens(frame)
        rotation_deg = self.rotation_of(frame)
        return replace(frame, camera=camera, up_camera=up_camera, rotation_deg=rotation_deg)

    def read_depth(
        self, path: Path, image: Path | None = None, size_px: tuple[int, int] | None = None
    ) -> DepthReading:
        """Read a depth file and align it with its image.

        Args:
            path: The depth file.
            image: The image that it belongs to, for messages; None if there is no image.
            size_px: Width and height of the image; None to leave the depth unaligned.

        Raises:
            InputError: The file cannot be read, its size differs from the image's and there is no
                depth camera, or a camera is for another aspect ratio or lacks.
        """
        depth_m = calib.read_depth(path, scale=self.depth_scale_m)
        height, width = depth_m.shape
        depth_m = self.depth_convention.corrected(
            depth_m, f"depth {path}", self._camera_of_depth(path, width, height)
        )
        check = calib.check_depth(depth_m)
        fault = f"depth {path}: {check.reason}" if isinstance(check, calib.DepthFailure) else None
        if size_px is None:
            return DepthReading(depth_m, fault)
        if self.depth_camera is not None:
            own = _depth_camera_of(self.depth_camera, path, width, height)
            return DepthReading(self._registered(depth_m, own, size_px), fault)
        if (width, height) != size_px:
            hint = "; pass --depth-camera if another camera took it" if self.camera else ""
            raise InputError(
                f"depth {path} is {width}x{height} px: expected {size_px[0]}x{size_px[1]} px, like"
                f" image {image}{orientation_note(image) if image else ''}{hint}"
            )
        return DepthReading(depth_m, fault)

    def read_beams(self, path: Path, size_px: tuple[int, int]) -> BeamReading:
        """Read a point cloud and project it into its image.

        Args:
            path: The cloud.
            size_px: Width and height of the image.

        Raises:
            InputError: The file cannot be read, camera or transform lack, hardly any point is in
                the picture, or the rig says something of depth images.
        """
        self.check_for_clouds(f"cloud {path}")
        camera = self.camera_for(*size_px)
        if camera is None or self.cloud_extrinsics is None:
            lacks = "--camera" if camera is None else "--extrinsic"
            raise InputError(
                f"cloud {path} is given with a picture and without {lacks}: expected both, to"
                " project it into the picture"
            )
        cloud = read_cloud(path)
        try:
            return BeamReading.of_cloud(cloud, camera, self.cloud_extrinsics)
        except calib.CloudError as error:
            raise calib.CloudError(f"cloud {path}: {error}") from error

    def check_for_clouds(self, name: str) -> None:
        """Raise InputError if unit, kind or correction of depth images is given for clouds."""
        if self.depth_convention != calib.DepthConvention():
            given = "--depth-kind" if self.depth_kind != "depth" else "--depth-scale"
            raise InputError(
                f"{given} is given for {name}: expected it for depth images alone, as the points"
                " of clouds are in metres"
            )

    def _camera_of_depth(self, path: Path, width: int, height: int) -> calib.PinholeCamera | None:
        """The camera of a range image; None if there is none, or the file holds depth."""
        if self.depth_kind == "depth":
            return None
        if self.depth_camera is not None:
            return _depth_camera_of(self.depth_camera, path, width, height)
        return self.camera_for(width, height)

    def _registered(
        self,
        depth_m: NDArray[np.float32],
        depth_camera: calib.PinholeCamera,
        size_px: tuple[int, int],
    ) -> NDArray[np.float32]:
        """Depth resampled from the depth camera's pixels to the image camera's."""
        camera = self.camera_for(*size_px)
        assert camera is not None
        transform = self.depth_extrinsics or calib.RigidTransform.identity()
        return calib.register_depth(depth_m, depth_camera, camera, transform)


@lru_cache(maxsize=64)
def _tell_own(what: str, options: str) -> None:
    _log.warning(
        "frames of this source have %s: %s is only for frames without one",
        *(what, options),
        extra={"is_remark": True},
    )


@lru_cache(maxsize=64)
def _tell_assumed(*words: str) -> None:
    if words:
        _log.warning(
            "± takes in usual errors of a camera, as nothing states those of yours: %s; `edgetree"
            " calibrate` measures them, and --rig-errors states them (in Python"
            " Rig(uncertainty=...))",
            ", ".join(words),
            extra={"is_remark": True},
        )


@lru_cache(maxsize=64)
def _warn_of_lens(camera: calib.PinholeCamera) -> None:
    size = np.array([camera.width, camera.height])
    corners_px = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]]) * size
    rays = calib.pixels_to_rays(camera, corners_px)[:, :2]
    straight_px = rays * [camera.fx, camera.fy] + [camera.cx + 0.5, camera.cy + 0.5]
    moved_px = float(np.linalg.norm(straight_px - corners_px, axis=1).max())
    terms = ", ".join(f"{term:g}" for term in camera.distortion)
    _log.warning(
        "the camera has a lens (%s %s) that moves the corners of the picture by up to %.3g px, and"
        " the depth is taken to be in the same unrectified pixels; if picture and depth are"
        " rectified, as from the ZED SDK, give the rectified camera, without distortion (of a ZED"
        " factory file the name that ends in _RECTIFIED)",
        *(camera.distortion_model, terms, moved_px),
    )


def _depth_camera_of(
    camera: calib.PinholeCamera, path: Path, width: int, height: int
) -> calib.PinholeCamera:
    """The depth camera, scaled to the size of a depth file."""
    try:
        return _of_size(camera, width, height)
    except calib.CameraError as error:
        raise calib.CameraError(
            f"depth {path} is {width}x{height} px: expected the aspect ratio of --depth-camera,"
            f" {camera.width}x{camera.height} px"
        ) from error


def _of_size(camera: calib.PinholeCamera, width: int, height: int) -> calib.PinholeCamera:
    same = (camera.width, camera.height) == (width, height)
    return camera if same and camera.has_size else camera.scaled(width, height)


def unit_vector(direction: ArrayLike) -> NDArray[np.float64]:
    """Scale a direction of three numbers to length 1.

    Raises:
        InputError: It is not a direction.
    """
    values = np.asarray(direction, np.float64)
    if values.shape != (3,) or not np.isfinite(values).all() or not values.any():
        raise InputError(
            f"up_camera is {values.tolist()}: expected a direction of three numbers, not all 0"
        )
    values = values / np.abs(values).max()
    return np.asarray(values / np.linalg.norm(values))
