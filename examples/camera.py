"""A RealSense, OAK or Orbbec camera in a program of your own: prints the stems of each frame.

    python examples/camera.py realsense

The argument is any source that `edgetree live` takes; cameras need the extra of their name.
"""

from __future__ import annotations

import sys

from edgetree import TreeDetector, default_model
from edgetree.live import LivePipeline
from edgetree.sources import open_live_source


def main() -> None:
    """Print the stems until Ctrl-C, or to the end of a recording."""
    source = sys.argv[1]
    detector = TreeDetector.load(default_model("depth"), warm_up=True)
    pipeline = LivePipeline(lambda: open_live_source(source), detector)
    for result in pipeline:
        for track in result.tracks:
            if track.state == "confirmed" and track.diameter_m:
                diameter = track.diameter_m
                print(f"stem {track.number}: {diameter.value:.3f} ± {diameter.std:.3f} m")
    print(pipeline.status.line())


if __name__ == "__main__":
    main()
