"""Open any source by its name: as frames one by one, or as a stream that is followed live."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from basetree.errors import InputError
from edgetree.frames.rig import Rig
from edgetree.sources.bags import is_bag, open_recording
from edgetree.sources.bags.topics import Modality
from edgetree.sources.cameras import open_camera, open_oak, open_orbbec, open_realsense
from edgetree.sources.drive import is_drive, open_drive
from edgetree.sources.files import has_images, open_files, open_source
from edgetree.sources.playing import Looped
from edgetree.sources.source import FrameSource

if TYPE_CHECKING:
    from edgetree.runtime.detector import TreeDetector

__all__ = ["SOURCE_FORMS", "is_stream", "open_frames", "open_live_source"]

SOURCE_FORMS: Final = (
    "realsense, oak, orbbec, a device (0, /dev/video0), an address (rtsp://..., http://...), a"
    " recording (.bag, .mcap, .db3 or the folder of a ROS 2 bag), a drive of the simulator, a"
    " folder of images, or a video"
)

_VENDORS: Final = {"realsense": open_realsense, "oak": open_oak, "orbbec": open_orbbec}
_OPTION_SOURCES: Final = {
    "topics": "recordings",
    "depth_scale_m": "recordings",
    "depth": "images",
    "loop": "files and recordings",
    "scene": "datasets of drives",
}
_DEVICE: Final = re.compile(r"(?:/dev/video)?(\d+)")
_ADDRESS: Final = re.compile(r"(?:rtsps?|https?|udp|tcp|rtmp)://")


def is_stream(path: Path) -> bool:
    """Whether a path is a recording or a drive, whose frames have times and cameras."""
    return is_drive(path) or (is_bag(path) and not has_images(path))


def open_frames(
    source: Path,
    depth: Path | None = None,
    *,
    rig: Rig | None = None,
    detector: TreeDetector | None = None,
    topics: Mapping[str, str] | None = None,
    depth_scale_m: float | None = None,
    scene: int | None = None,
) -> FrameSource:
    """Open the frames of files, a recording or a drive for a model.

    Args:
        source: an image, a folder of images, a video, a recording, or a dataset of the preset
            `drive`.
        depth: depth image or folder of depth images, as for `open_source`. If it is not given, the
            images themselves are depth for a model that takes depth.
        rig: the cameras and the unit of the depth images.
        detector: the model; None if the trees come from a mask image.
        topics: names of topics by role, for recordings.
        depth_scale_m: metres per unit of the depth, for recordings.
        scene: number of the drive in a dataset with several.

    Returns:
        The frames; iterating over images is as for `open_source`.

    Raises:
        InputError: there is no such source, or an option does not fit it.
        MissingPackage: the package for recordings is not installed.
    """
    streams = is_stream(source)
    is_recording = streams and not is_drive(source)
    _check_options(
        str(source),
        {
            "topics": bool(topics) and not is_recording,
            "depth_scale_m": depth_scale_m is not None and not is_recording,
            "depth": depth is not None and streams,
            "scene": scene is not None and not is_drive(source),
        },
    )
    if is_recording:
        return open_recording(source, topics=topics, depth_scale_m=depth_scale_m)
    if streams:
        return open_drive(source, scene=scene)
    takes_depth = detector is not None and detector.manifest.takes_depth
    return open_source(source, depth, depth_only=depth is None and takes_depth, rig=rig)


def open_live_source(
    text: str,
    *,
    depth: Path | None = None,
    rig: Rig | None = None,
    topics: Mapping[str, str] | None = None,
    depth_scale_m: float | None = None,
    modality: Modality = "both",
    scene: int | None = None,
    loop: bool = False,
) -> FrameSource:
    """Open a camera, a recording or files; what it is follows from the text.

    Args:
        text: "realsense", "oak", "orbbec"; a V4L2 device as 0 or /dev/video0; an address such as
            rtsp://camera/1; a GStreamer pipeline; or a path of a recording, a dataset of the
            preset `drive`, an image, a folder of images or a video.
        depth: depth image or folder of depth images; for images alone.
        rig: cameras and gravity of images, videos and cameras without intrinsics of their own.
        topics: names of topics by role, for recordings.
        depth_scale_m: metres per unit of the depth, for recordings.
        modality: which images of a recording are read. Of "depth", images in files are depth.
        scene: number of the drive in a dataset with several.
        loop: whether a recording starts again at its end, for ever.

    Raises:
        InputError: there is no such source, or an option does not fit it.
        SourceLost: the camera does not answer.
        MissingPackage: the package for the source is not installed.
    """
    name = text.strip()
    is_camera = name in _VENDORS or "!" in name or bool(_ADDRESS.match(name))
    is_camera = is_camera or _DEVICE.fullmatch(name) is not None
    path = Path(name)
    is_recording = not is_camera and is_bag(path)
    _check_options(
        text,
        {
            "topics": bool(topics) and not is_recording,
            "depth_scale_m": depth_scale_m is not None and not is_recording,
            "depth": depth is not None and (is_camera or is_recording or is_drive(path)),
            "loop": loop and is_camera,
            "scene": scene is not None and not is_drive(path),
        },
    )
    if is_camera:
        return _open_camera(name, rig or Rig())
    if is_recording:
        source = open_recording(path, topics=topics, depth_scale_m=depth_scale_m, modality=modality)
    elif is_drive(path):
        source = open_drive(path, scene=scene)
    else:
        source = open_files(path, depth, depth_only=modality == "depth", rig=rig)
    return Looped(source) if loop else source


def _open_camera(name: str, rig: Rig) -> FrameSource:
    if name in _VENDORS:
        return _VENDORS[name](up_camera=rig.up_camera)
    device = _DEVICE.fullmatch(name)
    address = name if device is None else int(device[1])
    return open_camera(address, camera=rig.camera, up_camera=rig.up_camera)


def _check_options(text: str, wrong: Mapping[str, bool]) -> None:
    for option, is_wrong in wrong.items():
        if is_wrong:
            raise InputError(
                f"{option} is given for source {text}: expected it for {_OPTION_SOURCES[option]}"
                " alone"
            )
