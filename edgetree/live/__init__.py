"""Live: stems followed over time in the frames of a camera or a recording, results as they come.

from edgetree import TreeDetector, default_model
from edgetree.live import LivePipeline
from edgetree.sources import open_live_source

detector = TreeDetector.load(default_model("depth"))
for result in LivePipeline(lambda: open_live_source("drive.mcap"), detector):
    for track in result.tracks:
        print(track.number, track.diameter_m)
"""

from basetree.deprecation import moved_names
from edgetree.live.pipeline import LivePipeline
from edgetree.live.results import LiveResult
from edgetree.live.status import LiveStatus
from edgetree.live.tracking.tracks import TreeTrack

__all__ = ["LivePipeline", "LiveResult", "LiveStatus", "TreeTrack"]

__getattr__ = moved_names(
    __name__,
    {
        "LiveFrame": "edgetree.frames.stream_frame",
        "LiveSource": "edgetree.sources.FrameSource",
        "SourceLost": "edgetree.sources.SourceLost",
    },
)
