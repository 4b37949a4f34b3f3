"""A ZED camera as a live source: prints the stems of each frame.

    python examples/zed.py

Needs pyzed, which comes with the SDK of Stereolabs. Written by its documentation and tested against
a fake of it, never with a camera.
"""

from __future__ import annotations

from collections.abc import Iterator

import pyzed.sl as sl

from calib import PinholeCamera
from edgetree import TreeDetector, default_model
from edgetree.frames import Frame
from edgetree.live import LivePipeline
from edgetree.sources import SourceLost, frame_from_arrays

NS_PER_S = 1e9
MOST_FAILURES = 30


class ZedFrames:
    """The left picture and its depth, in metres."""

    name = "ZED"
    is_live = True

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._camera = sl.Camera()
        settings = sl.InitParameters(
            coordinate_units=sl.UNIT.METER, depth_mode=sl.DEPTH_MODE.NEURAL
        )
        if self._camera.open(settings) != sl.ERROR_CODE.SUCCESS:
            raise SourceLost("the ZED camera does not answer: expected one that is connected")
        self._is_open = True

    def __iter__(self) -> Iterator[Frame]:
        configuration = self._camera.get_camera_information().camera_configuration
        left = configuration.calibration_parameters.left_cam
        size = configuration.resolution
        # The pictures are rectified, so there is no distortion.
        camera = PinholeCamera(size.width, size.height, left.fx, left.fy, left.cx, left.cy)
        colour, depth, number, failures = sl.Mat(), sl.Mat(), 0, 0
        while self._is_open:
            if self._camera.grab() != sl.ERROR_CODE.SUCCESS:
                failures += 1
                if failures > MOST_FAILURES:
                    raise SourceLost("the ZED camera does not answer any more")
                continue
            failures = 0
            self._camera.retrieve_image(colour, sl.VIEW.LEFT)
            self._camera.retrieve_measure(depth, sl.MEASURE.DEPTH)
            stamp = self._camera.get_timestamp(sl.TIME_REFERENCE.IMAGE)
            yield frame_from_arrays(
                number,
                stamp.get_nanoseconds() / NS_PER_S,
                colour.get_data(),  # BGRA
                depth.get_data(),  # float32; NaN and infinity are no reading
                camera=camera,
            )
            number += 1

    def close(self) -> None:
        """Release the camera."""
        if self._is_open:
            self._is_open = False
            self._camera.close()


def main() -> None:
    """Print the stems until Ctrl-C."""
    detector = TreeDetector.load(default_model("depth"), warm_up=True)
    for result in LivePipeline(ZedFrames, detector):
        for track in result.tracks:
            if track.state == "confirmed" and track.diameter_m:
                diameter = track.diameter_m
                print(f"stem {track.number}: {diameter.value:.3f} ± {diameter.std:.3f} m")


if __name__ == "__main__":
    main()
