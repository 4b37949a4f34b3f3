"""The frames of a conformance kit: the sample frames, and cuts that need other resizing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from calib.depth.files import in_millimetres
from edgetree.samples import SampleFrame, sample_frames

# Name, sample, rows and columns. Each is resized in another way: by a factor that is not whole,
# with the padding at the right, with a side that is rounded, and enlarged.
_CUTS: Final = (
    ("wide", 0, slice(240, 660), slice(0, 1280)),
    ("tall", 2, slice(0, 720), slice(460, 960)),
    ("odd", 3, slice(59, 720), slice(100, 1101)),
    ("small", 0, slice(90, 350), slice(940, 1273)),
)
_BLANK_PX: Final = (480, 640)


def frames_for(*, takes_depth: bool) -> Iterator[tuple[str, NDArray[Any]]]:
    """The name and the pixels of each frame.

    Args:
        takes_depth: Whether the model takes depth.

    Yields:
        uint8 (H, W, 3) BGR, or uint16 (H, W) millimetres with 0 for no reading.
    """
    samples = sample_frames()
    for sample in samples:
        yield sample.name, _pixels(sample, takes_depth)
    for name, index, rows, columns in _CUTS:
        yield name, np.ascontiguousarray(_pixels(samples[index], takes_depth)[rows, columns])
    blank = np.zeros(_BLANK_PX, np.uint16) if takes_depth else np.zeros((*_BLANK_PX, 3), np.uint8)
    yield "blank", blank


def _pixels(sample: SampleFrame, takes_depth: bool) -> NDArray[Any]:
    return in_millimetres(sample.depth_m()) if takes_depth else sample.image()
