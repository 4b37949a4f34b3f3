"""Open files, a recording or a drive as frames, one by one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

from basetree.errors import InputError
from edgetree.frames.rig import Rig
from edgetree.sources.bags.names import is_bag
from edgetree.sources.drive import is_drive, open_drive
from edgetree.sources.files import open_source
from edgetree.sources.folders import has_images
from edgetree.sources.phones.opening import is_capture, open_capture
from edgetree.sources.source import FrameSource

if TYPE_CHECKING:
    from calib.stereo import StereoPair
    from edgetree.runtime.detector import TreeDetector

_OPTION_SOURCES: Final = {
    "topics": "recordings",
    "depth_scale_m": "files, recordings and drives",
    "depth_kind": "files, recordings and drives",
    "depth_calibration": "sources with depth",
    "depth": "images",
    "right": "pictures and videos",
    "loop": "files and recordings",
    "scene": "datasets of drives",
}


def is_stream(path: Path) -> bool:
    """Whether a path is a recording, a drive or a capture, whose frames have times and cameras."""
    return is_drive(path) or is_capture(path) or (is_bag(path) and not has_images(path))


def open_frames(
    source: Path | str,
    depth: Path | str | None = None,
    *,
    rig: Rig | None = None,
    detector: TreeDetector | None = None,
    topics: Mapping[str, str] | None = None,
    depth_scale_m: float | None = None,
    scene: int | None = None,
    pair: StereoPair | None = None,
) -> FrameSource:
    """Open the frames of files, a recording or a drive for a model.

    Args:
        source: An image, a folder of images, a video, a recording, a capture of a phone, or a
            dataset of the preset `drive`.
        depth: Depth image or folder of depth images, as for `open_source`. If it is not given, the
            images themselves are depth for a model that takes depth.
        rig: The cameras, and unit, kind and correction of the depth.
        detector: The model; None if the trees come from a mask image.
        topics: Names of topics by role, for recordings.
        depth_scale_m: Metres per unit of the depth; that of `rig` if None.
        scene: Number of the drive in a dataset with several.
        pair: Calibration of two cameras, for recordings of which `topics` names `right`.

    Returns:
        The frames; iterating over images is as for `open_source`.

    Raises:
        InputError: There is no such source, or an option does not fit it.
        MissingPackage: The package for recordings is not installed.
    """
    source, depth = Path(source), None if depth is None else Path(depth)
    rig = with_scale(rig, depth_scale_m)
    streams = is_stream(source)
    is_recording = streams and not (is_drive(source) or is_capture(source))
    check_options(
        str(source),
        {
            "topics": bool(topics) and not is_recording,
            "depth": depth is not None and streams,
            "scene": scene is not None and not is_drive(source),
        },
    )
    if is_recording:
        from edgetree.sources.bags.recording import open_recording
        from edgetree.sources.stereo import open_stereo_recording

        if pair is not None:
            return open_stereo_recording(source, pair, topics=topics or {}, rig=rig)
        return open_recording(source, topics=topics, rig=rig)
    if is_capture(source):
        return open_capture(source, rig=rig)
    if streams:
        return open_drive(source, scene=scene, rig=rig)
    takes_depth = detector is not None and detector.manifest.takes_depth
    return open_source(source, depth, depth_only=depth is None and takes_depth, rig=rig)


def with_scale(rig: Rig | None, depth_scale_m: float | None) -> Rig:
    """The rig, with a number of metres per unit of the depth if that is given."""
    rig = rig or Rig()
    return rig if depth_scale_m is None else replace(rig, depth_scale_m=depth_scale_m)


def check_options(text: str, wrong: Mapping[str, bool]) -> None:
    """Raise InputError for the first option that is wrong for a source."""
    for option, is_wrong in wrong.items():
        if is_wrong:
            raise InputError(
                f"{option} is given for source {text}: expected it for {_OPTION_SOURCES[option]}"
                " alone"
            )
