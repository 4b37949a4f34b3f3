"""Write the frames of a recording or drive as raw pixels, in place of a camera: SOURCE OUT.

OUT/frames.txt has a line for each frame: name, time, width, height, fx, fy, cx, cy, the vertical,
and the rotation and translation of the pose. NAME.bgr and NAME.depth hold the pixels.
"""

import sys
from pathlib import Path

import numpy as np

from edgetree.sources import open_live_source


def main(source: str, out: Path) -> None:
    """Write the frames."""
    out.mkdir(parents=True)
    lines = []
    for frame in open_live_source(source):
        camera, pose = frame.camera, frame.pose
        frame.image.tofile(out / f"{frame.name}.bgr")
        frame.depth_m.astype(np.float32).tofile(out / f"{frame.name}.depth")
        lens = (camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy)
        place = (*frame.up_camera, *pose.rotation.ravel(), *pose.translation_m)
        numbers = " ".join(repr(float(value)) for value in (*lens[2:], *place))
        lines.append(f"{frame.name} {frame.time_s!r} {lens[0]} {lens[1]} {numbers}\n")
    (out / "frames.txt").write_text("".join(lines), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
