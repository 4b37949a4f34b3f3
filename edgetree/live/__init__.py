"""Live: frames from cameras and recordings, stems followed over time, results as they come.

from edgetree import TreeDetector, default_model
from edgetree.live import LivePipeline
from edgetree.live.sources import open_live_source

detector = TreeDetector.load(default_model("depth"))
for result in LivePipeline(lambda: open_live_source("drive.mcap"), detector):
    for track in result.tracks:
        print(track.number, track.diameter_m)
"""

from edgetree.live.frames import LiveFrame, LiveSource, SourceLost
from edgetree.live.pipeline import LivePipeline
from edgetree.live.results import LiveResult
from edgetree.live.status import LiveStatus
from edgetree.live.tracking.tracks import TreeTrack

__all__ = [
    "LiveFrame",
    "LivePipeline",
    "LiveResult",
    "LiveSource",
    "LiveStatus",
    "SourceLost",
    "TreeTrack",
]
