"""Sources of frames: files, recordings, cameras, and what a program hands over.

    from edgetree.sources import open_live_source

    for frame in open_live_source("drive.mcap"):
        print(frame.number, frame.time_s)

Packages that only some sources need, such as rosbags, are imported when such a source is opened.
"""

from edgetree.sources.arrays import frame_from_arrays
from edgetree.sources.bags import open_recording
from edgetree.sources.cameras import open_camera, open_oak, open_orbbec, open_realsense
from edgetree.sources.drive import open_drive
from edgetree.sources.files import open_files, open_source
from edgetree.sources.opening import SOURCE_FORMS, open_frames, open_live_source
from edgetree.sources.pushed import PushedFrames
from edgetree.sources.source import FrameSource, SourceLost

__all__ = [
    "SOURCE_FORMS",
    "FrameSource",
    "PushedFrames",
    "SourceLost",
    "frame_from_arrays",
    "open_camera",
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
