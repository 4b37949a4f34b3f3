"""Sources of frames: files, recordings, cameras, and what a program hands over.

    from edgetree.sources import open_live_source

    for frame in open_live_source("drive.mcap"):
        print(frame.number, frame.time_s)

Names are imported on first use, and packages that only some sources need, such as rosbags, when
such a source is opened.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from edgetree.sources.arrays import frame_from_arrays
    from edgetree.sources.bags.recording import open_recording
    from edgetree.sources.cameras.oak import open_oak
    from edgetree.sources.cameras.opencv import open_camera
    from edgetree.sources.cameras.orbbec import open_orbbec
    from edgetree.sources.cameras.realsense import open_realsense
    from edgetree.sources.depth_there import model_for
    from edgetree.sources.drive import open_drive
    from edgetree.sources.files import open_files, open_source
    from edgetree.sources.live import SOURCE_FORMS, open_live_source
    from edgetree.sources.opening import open_frames
    from edgetree.sources.phones.opening import open_capture
    from edgetree.sources.pushed import PushedFrames
    from edgetree.sources.ros_topics import TopicFrames
    from edgetree.sources.source import FrameSource, SourceLost

__all__ = [
    "SOURCE_FORMS",
    "FrameSource",
    "PushedFrames",
    "SourceLost",
    "TopicFrames",
    "frame_from_arrays",
    "model_for",
    "open_camera",
    "open_capture",
    "open_drive",
    "open_files",
    "open_frames",
    "open_live_source",
    "open_oak",
    "open_orbbec",
    "open_realsense",
    "open_recording",
    "open_source",
]

_MODULES = {
    "frame_from_arrays": "arrays",
    "open_recording": "bags.recording",
    "open_oak": "cameras.oak",
    "open_camera": "cameras.opencv",
    "open_orbbec": "cameras.orbbec",
    "open_realsense": "cameras.realsense",
    "model_for": "depth_there",
    "open_drive": "drive",
    "open_files": "files",
    "open_source": "files",
    "SOURCE_FORMS": "live",
    "open_live_source": "live",
    "open_frames": "opening",
    "open_capture": "phones.opening",
    "PushedFrames": "pushed",
    "TopicFrames": "ros_topics",
    "FrameSource": "source",
    "SourceLost": "source",
}


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
