"""Encodings of colour and depth in Image messages, and sizes that do not fit their bytes."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from edgetree.sources.bags.encodings import ColourPixels, decode_depth_pixels
from edgetree.sources.bags.recording import open_recording


def picture() -> np.ndarray:
    """(48, 64, 3) uint8 BGR of four plain colours."""
    values = np.zeros((48, 64, 3), np.uint8)
    values[:24, :32], values[:24, 32:] = (40, 120, 200), (200, 60, 30)
    values[24:, :32], values[24:, 32:] = (90, 180, 60), (150, 150, 150)
    return values


def message(values: np.ndarray, encoding: str, **changed: Any) -> Any:
    """An Image of (rows, bytes or values) pixels of 64x48 px."""
    data = np.frombuffer(np.ascontiguousarray(values).tobytes(), np.uint8)
    step = data.size // values.shape[0]
    fields = {"width": 64, "height": 48, "step": step, "is_bigendian": 0, "data": data}
    return SimpleNamespace(encoding=encoding, **(fields | changed))


def planes(bgr: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Brightness, and blue and red of half the size."""
    packed = cv2.cvtColor(bgr, cv2.COLOR_BGR2YUV_I420)
    blue, red = packed[48:60].reshape(24, 32), packed[60:].reshape(24, 32)
    return packed[:48], blue, red


def half(bgr: np.ndarray, order: str) -> np.ndarray:
    light, blue, red = planes(bgr)
    colour = {"ub": [blue, red], "ur": [red, blue]}[order]
    return np.vstack([light, np.dstack(colour).reshape(24, 64)])


def in_planes(bgr: np.ndarray, *, red_first: bool) -> np.ndarray:
    light, blue, red = planes(bgr)
    colour = [red, blue] if red_first else [blue, red]
    return np.vstack([light, *(each.reshape(12, 64) for each in colour)])


def yuyv(bgr: np.ndarray, order: str) -> np.ndarray:
    light, blue, red = planes(bgr)
    blue, red = (np.repeat(each, 2, 0) for each in (blue, red))
    parts = {"y": light[:, ::2], "z": light[:, 1::2], "u": blue, "v": red}
    return np.dstack([parts[name] for name in order]).reshape(48, 128)


def mosaic(bgr: np.ndarray) -> np.ndarray:
    read = bgr[..., 1].copy()
    read[::2, ::2], read[1::2, 1::2] = bgr[::2, ::2, 2], bgr[1::2, 1::2, 0]
    return read


def wide(values: np.ndarray, bits: int = 16) -> np.ndarray:
    """Values of 8 bits as 16 bits of a sensor of fewer bits."""
    return (values.astype(np.uint32) * (2**bits - 1) // 255).astype(np.uint16)


ENCODINGS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "nv12": lambda bgr: half(bgr, "ub"),
    "NV12": lambda bgr: half(bgr, "ub"),
    "nv21": lambda bgr: half(bgr, "ur"),
    "i420": lambda bgr: in_planes(bgr, red_first=False),
    "yuv420p": lambda bgr: in_planes(bgr, red_first=False),
    "yv12": lambda bgr: in_planes(bgr, red_first=True),
    "YUYV": lambda bgr: yuyv(bgr, "yuzv"),
    "yuy2": lambda bgr: yuyv(bgr, "yuzv"),
    "yuv422_yuy2": lambda bgr: yuyv(bgr, "yuzv"),
    "yvyu": lambda bgr: yuyv(bgr, "yvzu"),
    "UYVY": lambda bgr: yuyv(bgr, "uyvz"),
    "yuv422": lambda bgr: yuyv(bgr, "uyvz"),
    "RGB8": lambda bgr: bgr[..., ::-1],
    "rgb16": lambda bgr: wide(bgr[..., ::-1]),
    "bgr16": wide,
    "16UC3": wide,
    "rgba16": lambda bgr: wide(np.dstack([bgr[..., ::-1], bgr[..., 0]])),
    "bayer_rggb16": lambda bgr: wide(mosaic(bgr)),
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_encodings_become_bgr(encoding: str) -> None:
    expected = picture()
    found = ColourPixels().decode(message(ENCODINGS[encoding](expected), encoding))
    off = np.abs(found.astype(int) - expected)
    off[22:26], off[:, 30:34] = 0, 0  # where two colours meet, a mosaic mixes them
    assert off.max() <= 4


@pytest.mark.parametrize("bits", [10, 12, 14, 16])
@pytest.mark.parametrize("order", ["<", ">"])
def test_sensors_of_10_to_16_bits_are_as_bright_as_those_of_8(bits: int, order: str) -> None:
    expected = picture()
    expected[0, 0] = 255
    values = wide(expected, bits).astype(f"{order}u2")
    decoder = ColourPixels()
    found = decoder.decode(message(values, "bgr16", is_bigendian=int(order == ">")))
    assert np.abs(found.astype(int) - expected).max() <= 1
    assert decoder.bits == bits
    dark = decoder.decode(message(wide(expected // 8, bits), "bgr16"))
    assert np.abs(dark.astype(int) - expected // 8).max() <= 1  # a dark picture does not flare up


@pytest.mark.parametrize("encoding", ["nv12", "i420"])
def test_padded_rows_of_half_colour(encoding: str) -> None:
    values = ENCODINGS[encoding](picture())
    tight = ColourPixels().decode(message(values, encoding))
    if encoding == "nv12":
        padded = np.pad(values, ((0, 0), (0, 16)))
    else:
        colour = np.pad(values[48:].reshape(48, 32), ((0, 0), (0, 8))).reshape(24, 80)
        padded = np.vstack([np.pad(values[:48], ((0, 0), (0, 16))), colour])
    found = ColourPixels().decode(message(padded, encoding, step=80))
    np.testing.assert_array_equal(found, tight)
    stated = ColourPixels().decode(message(values, encoding, step=96))  # the bytes of all planes
    np.testing.assert_array_equal(stated, tight)


@pytest.mark.parametrize(
    ("encoding", "kind"), [("16SC1", "i2"), ("32SC1", "i4"), ("64FC1", "f8"), ("z16", "u2")]
)
def test_encodings_of_depth(encoding: str, kind: str) -> None:
    expected = np.arange(1, 48 * 64 + 1).reshape(48, 64)
    values = expected.astype(kind)
    values[0, 0] = -1 if kind[0] != "u" else 0
    found = decode_depth_pixels(message(values, encoding))
    np.testing.assert_array_equal(found[1:], expected[1:])
    assert found[0, 0] <= 0


@pytest.mark.parametrize("encoding", ["bgr8", "nv12", "i420", "bayer_rggb16", "16UC1"])
@pytest.mark.parametrize(
    "stated",
    [
        {"step": 2**32 - 1},
        {"step": 2**32 - 1, "height": 1},
        {"step": 2**32 - 1, "height": 2},
        {"step": 1},
        {"height": 2**32 - 1},
        {"width": 2**32 - 1},
        {"width": 2**31, "height": 2**31},
        {"width": 0},
        {"height": 0},
        {"width": 10_000, "height": 10_000, "step": 0},
        {"data": np.zeros(0, np.uint8)},
        {"data": np.zeros(100, np.uint8), "step": 0},
    ],
)
def test_sizes_that_do_not_fit_the_bytes(encoding: str, stated: dict[str, Any]) -> None:
    values = np.zeros((48, 64, 3), np.uint8)
    decode = decode_depth_pixels if encoding == "16UC1" else ColourPixels().decode
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="expected"):
            decode(message(values, encoding, **stated))
        assert tracemalloc.get_traced_memory()[1] < 10**6
    finally:
        tracemalloc.stop()


def test_the_bits_that_were_assumed_are_said(
    bags: Any, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.COLOUR, wide(picture(), 12), bags.START_NS, "bgr16")
    list(open_recording(bag.path))
    assert f"topic {bags.COLOUR}: values of 16 bits are read as of 12 bits" in caplog.text


def test_depth_of_32_bits_may_be_in_micrometres(bags: Any, tmp_path: Path) -> None:
    steps = np.full((48, 64), 4_000_000, np.int32)
    steps[0, :2] = -1, 2**31 - 1  # no reading
    with bags.BagFile(tmp_path) as bag:
        bag.image(bags.DEPTH, steps, bags.START_NS, "32SC1")
    (frame,) = open_recording(bag.path, depth_scale_m=1e-6)
    assert not frame.depth_m[0, :2].any()
    np.testing.assert_allclose(frame.depth_m[1:], 4.0)
