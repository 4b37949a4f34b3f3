"""The frames of a conformance kit: the sample frames, and cuts that need other resizing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Any, Final, TypeAlias

import numpy as np
from msgspec import Meta
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
# Likewise, and their camera is given: one shows a stem beyond 10 m, the other one stems near there.
_WITH_CAMERA: Final = (
    ("beyond_reach", 1, slice(0, 720), slice(300, 1280)),
    ("near_reach", 3, slice(0, 600), slice(100, 1000)),
)
_ALONE: Final = {"odd": "colour", "small": "depth", "blank": "depth"}
"""Frames that a model of both is given one image of."""

FramePixels: TypeAlias = NDArray[Any] | tuple[NDArray[Any], NDArray[Any]]
"""uint8 (H, W, 3) BGR, uint16 (H, W) millimetres with 0 for no reading, or both."""
_Images: TypeAlias = dict[str, NDArray[Any]]


@dataclass(frozen=True)
class KitCamera:
    """A pinhole camera without distortion.

    Attributes:
        fx: Focal length along x in px.
        fy: Focal length along y in px.
        cx: Principal point along x in px, from the middle of the first pixel.
        cy: Principal point along y in px, likewise.
    """

    fx: Annotated[float, Meta(gt=0, le=1e6)]
    fy: Annotated[float, Meta(gt=0, le=1e6)]
    cx: Annotated[float, Meta(ge=-1e6, le=1e6)]
    cy: Annotated[float, Meta(ge=-1e6, le=1e6)]


def frames_for(
    modality: str, *, cameras: bool
) -> Iterator[tuple[str, FramePixels, KitCamera | None]]:
    """The name and the pixels of each frame, and its camera if that is given.

    Args:
        modality: What the model takes: `rgb`, `depth` or `both`. Of both some frames are colour
            or depth alone.
        cameras: Whether there are frames with a camera.
    """
    kinds = {"rgb": ("colour",), "depth": ("depth",), "both": ("colour", "depth")}[modality]
    for name, both, camera in _both(cameras):
        alone = _ALONE.get(name) if len(kinds) > 1 else None
        given = [both[kind] for kind in ((alone,) if alone else kinds)]
        yield name, given[0] if len(given) == 1 else (given[0], given[1]), camera


def _both(cameras: bool) -> Iterator[tuple[str, _Images, KitCamera | None]]:
    """The name of each frame, its colour and depth, and its camera if that is given."""
    samples = sample_frames()
    for sample in samples:
        yield sample.name, _pixels(sample), None
    for name, index, rows, columns in _CUTS:
        yield name, _cut(samples[index], rows, columns), None
    for name, index, rows, columns in _WITH_CAMERA if cameras else ():
        whole = samples[index].camera
        camera = KitCamera(whole.fx, whole.fy, whole.cx - columns.start, whole.cy - rows.start)
        yield name, _cut(samples[index], rows, columns), camera
    blank: _Images = {
        "colour": np.zeros((*_BLANK_PX, 3), np.uint8),
        "depth": np.zeros(_BLANK_PX, np.uint16),
    }
    yield "blank", blank, None


def _cut(sample: SampleFrame, rows: slice, columns: slice) -> _Images:
    whole = _pixels(sample).items()
    return {kind: np.ascontiguousarray(each[rows, columns]) for kind, each in whole}


def _pixels(sample: SampleFrame) -> _Images:
    return {"colour": sample.image(), "depth": in_millimetres(sample.depth_m())}
