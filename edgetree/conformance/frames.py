"""The frames of a conformance kit: the sample frames, and cuts that need other resizing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final, TypeAlias

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
_ALONE: Final = {"odd": "colour", "small": "depth", "blank": "depth"}
"""Frames that a model of both is given one image of."""

FramePixels: TypeAlias = NDArray[Any] | tuple[NDArray[Any], NDArray[Any]]
"""uint8 (H, W, 3) BGR, uint16 (H, W) millimetres with 0 for no reading, or both."""


def frames_for(modality: str) -> Iterator[tuple[str, FramePixels]]:
    """The name and the pixels of each frame.

    Args:
        modality: What the model takes: `rgb`, `depth` or `both`. Of both some frames are colour
            or depth alone.
    """
    kinds = {"rgb": ("colour",), "depth": ("depth",), "both": ("colour", "depth")}[modality]
    for name, both in _both():
        alone = _ALONE.get(name) if len(kinds) > 1 else None
        given = [both[kind] for kind in ((alone,) if alone else kinds)]
        yield name, given[0] if len(given) == 1 else (given[0], given[1])


def _both() -> Iterator[tuple[str, dict[str, NDArray[Any]]]]:
    """The name of each frame, and its colour and depth."""
    samples = sample_frames()
    for sample in samples:
        yield sample.name, _pixels(sample)
    for name, index, rows, columns in _CUTS:
        whole = _pixels(samples[index]).items()
        yield name, {kind: np.ascontiguousarray(each[rows, columns]) for kind, each in whole}
    yield (
        "blank",
        {
            "colour": np.zeros((*_BLANK_PX, 3), np.uint8),
            "depth": np.zeros(_BLANK_PX, np.uint16),
        },
    )


def _pixels(sample: SampleFrame) -> dict[str, NDArray[Any]]:
    return {"colour": sample.image(), "depth": in_millimetres(sample.depth_m())}
