"""The frames of a benchmark, in memory, with what measuring in metres needs where it is known."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Final

from basetree.arrays import Float32, Float64
from calib import PinholeCamera
from edgetree.frames.pipeline import image_for
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.pairs import ColourAndDepth, FrameImage
from edgetree.samples import sample_frames
from edgetree.sources import open_frames
from edgetree.sources.source import readable

MOST_FRAMES: Final = 16


@dataclass(frozen=True, eq=False)
class BenchFrame:
    """One frame of a benchmark.

    Attributes:
        image: What the model takes, as for `TreeDetector.detect`.
        decode_ms: Time to read and decode its file.
        depth_m: (H, W) depth in metres for measuring; None if it is not known.
        camera: The camera, likewise.
        up_camera: (3,) direction opposite to gravity in the camera's frame, likewise.
    """

    image: FrameImage
    decode_ms: float
    depth_m: Float32 | None = None
    camera: PinholeCamera | None = None
    up_camera: Float64 | None = None


def bench_frames(
    source: Path | None,
    detector: TreeDetector,
    on_error: Callable[[Exception], None] = lambda _: None,
) -> list[BenchFrame]:
    """Read the first `MOST_FRAMES` frames of a source; without a source the packaged ones.

    Args:
        source: An image, a folder or a video, as for `edgetree.sources.open_frames`.
        detector: The model that will take them.
        on_error: Called with the error of each frame that cannot be read.

    Raises:
        InputError: The source cannot be opened, or lacks the kind of image that the model takes.
    """
    if source is None:
        return list(_packaged(detector))
    frames = iter(islice(readable(open_frames(source, detector=detector), on_error), MOST_FRAMES))
    found = []
    start = time.perf_counter()
    for frame in frames:
        decode_ms = (time.perf_counter() - start) * 1000
        found.append(BenchFrame(image_for(detector, frame), decode_ms))
        start = time.perf_counter()
    return found


def _packaged(detector: TreeDetector) -> Iterator[BenchFrame]:
    for sample in sample_frames():
        start = time.perf_counter()
        image: FrameImage = sample.image()
        if detector.manifest.takes_depth:
            image = sample.depth_m()
        elif detector.manifest.takes_both:
            image = ColourAndDepth(sample.image(), sample.depth_m())
        decode_ms = (time.perf_counter() - start) * 1000
        yield BenchFrame(image, decode_ms, sample.depth_m(), sample.camera, sample.up_camera)
