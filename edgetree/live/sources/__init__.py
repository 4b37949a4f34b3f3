"""Sources of live frames: recordings, cameras, files, and the arrays of drivers.

    from edgetree.live.sources import open_live_source

    for frame in open_live_source("drive.mcap"):
        print(frame.number, frame.time_s)

Packages that only some sources need, such as rosbags, are imported when such a source is opened.
"""

from edgetree.live.sources.arrays import frame_from_arrays
from edgetree.live.sources.camera import open_camera
from edgetree.live.sources.drive import open_drive
from edgetree.live.sources.files import open_files
from edgetree.live.sources.oak import open_oak
from edgetree.live.sources.opening import SOURCE_FORMS, open_live_source
from edgetree.live.sources.orbbec import open_orbbec
from edgetree.live.sources.pushed import PushedFrames
from edgetree.live.sources.realsense import open_realsense
from edgetree.live.sources.recording import open_recording

__all__ = [
    "SOURCE_FORMS",
    "PushedFrames",
    "frame_from_arrays",
    "open_camera",
    "open_drive",
    "open_files",
    "open_live_source",
    "open_oak",
    "open_orbbec",
    "open_realsense",
    "open_recording",
]
