"""Open any live source by a text, as given on the command line."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from basetree.secrets import hide_secrets
from calib import DepthScale
from calib.stereo import StereoPair
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.sources.bags.names import is_bag
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.bags.topics import Modality
from edgetree.sources.cameras.oak import open_oak
from edgetree.sources.cameras.opencv import open_camera
from edgetree.sources.cameras.orbbec import open_orbbec
from edgetree.sources.cameras.realsense import open_realsense
from edgetree.sources.drive import is_drive, open_drive
from edgetree.sources.files import as_stream, open_files
from edgetree.sources.opening import check_options, with_scale
from edgetree.sources.phones.opening import is_capture, open_capture
from edgetree.sources.playing import Changed, Looped
from edgetree.sources.source import FrameSource
from edgetree.sources.stereo import open_stereo, open_stereo_recording

SOURCE_FORMS: Final = (
    "realsense, oak, orbbec, a device (0, /dev/video0), an address (rtsp://..., http://...), a"
    " recording (.bag, .mcap, .db3 or the folder of a ROS 2 bag), a capture of a phone (.r3d or the"
    " folder of Stray Scanner), a drive of the simulator, a folder of images, or a video"
)

VENDORS: Final = {"realsense": open_realsense, "oak": open_oak, "orbbec": open_orbbec}
"""What opens the cameras with depth, by name."""
_DEVICE: Final = re.compile(r"(?:/dev/video)?(\d+)")
_ADDRESS: Final = re.compile(r"(?:rtsps?|https?|udp|tcp|rtmp)://")


def open_live_source(
    text: str | Path,
    *,
    depth: Path | None = None,
    right: Path | None = None,
    rig: Rig | None = None,
    topics: Mapping[str, str] | None = None,
    depth_scale_m: float | None = None,
    modality: Modality = "both",
    scene: int | None = None,
    loop: bool = False,
    pair: StereoPair | None = None,
) -> FrameSource:
    """Open a camera, a recording or files; what it is follows from the text.

    Args:
        text: "realsense", "oak", "orbbec"; a V4L2 device as 0 or /dev/video0; an address such as
            rtsp://camera/1; a GStreamer pipeline; or a path of a recording, a capture of a phone,
            a dataset of the preset `drive`, an image, a folder of images or a video.
        depth: Depth image or folder of depth images; for images alone.
        right: Picture, folder or video of the right camera of a stereo pair; with `pair`.
        rig: Cameras and gravity; unit, kind and correction of the depth. Its camera takes the place
            of the source's own; its vertical is for frames without one.
        topics: Names of topics by role, for recordings.
        depth_scale_m: Metres per unit of the depth; that of `rig` if None.
        modality: Which images of a recording are read. Of "depth", images in files are depth.
        scene: Number of the drive in a dataset with several.
        loop: Whether a recording starts again at its end, for ever.
        pair: Calibration of two cameras, for `right`, and for recordings of which `topics` names
            `right`.

    Raises:
        InputError: There is no such source, or an option does not fit it.
        SourceLost: The camera does not answer.
        MissingPackage: The package for the source is not installed.
    """
    rig = with_scale(rig, depth_scale_m)
    text = str(text)
    name = text.strip()
    camera = is_camera(name)
    path = Path(name)
    is_phone = not camera and is_capture(path)
    is_recording = not (camera or is_phone) and is_bag(path)
    are_pictures = not (camera or is_recording or is_phone or is_drive(path))
    check_options(
        hide_secrets(text),
        {
            "topics": bool(topics) and not is_recording,
            "depth_scale_m": rig.depth_scale_m is not None and camera,
            "depth_kind": rig.depth_kind != "depth" and camera,
            "depth_calibration": rig.depth_calibration is not None
            and camera
            and name not in VENDORS,
            "depth": depth is not None and not are_pictures,
            "right": right is not None and not are_pictures,
            "loop": loop and camera,
            "scene": scene is not None and not is_drive(path),
        },
    )
    if camera:
        return _open_camera(name, rig)
    if is_recording and pair is not None:
        source = open_stereo_recording(path, pair, topics=topics or {}, rig=rig)
    elif is_recording:
        source = open_recording(path, topics=topics, modality=modality, rig=rig)
    elif is_phone:
        source = open_capture(path, rig=rig)
    elif is_drive(path):
        source = open_drive(path, scene=scene, rig=rig)
    elif right is not None and pair is not None:
        source = as_stream(open_stereo(path, right, pair, rig=rig), rig)
    else:
        source = open_files(path, depth, depth_only=modality == "depth", rig=rig)
    return Looped(source) if loop else source


def is_camera(text: str) -> bool:
    """Whether a text names a camera, as for `open_live_source`."""
    name = text.strip()
    return name in VENDORS or "!" in name or bool(_ADDRESS.match(name) or _DEVICE.fullmatch(name))


def _open_camera(name: str, rig: Rig) -> FrameSource:
    if name in VENDORS:
        source = VENDORS[name](up_camera=rig.up_camera)
        if rig.depth_calibration is None:
            return source
        return Changed(source, partial(_calibrated, calibration=rig.depth_calibration))
    device = _DEVICE.fullmatch(name)
    address = name if device is None else int(device[1])
    return open_camera(address, camera=rig.camera, up_camera=rig.up_camera)


def _calibrated(frame: Frame, calibration: DepthScale) -> Frame:
    """A frame of a camera that knows its unit, with the depth corrected."""
    return (
        frame if frame.depth_m is None else replace(frame, depth_m=calibration.apply(frame.depth_m))
    )
