"""RVL depth: what is written is read, and code that does not fit its size is refused."""

from __future__ import annotations

import struct
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from packets import rvl

from basetree.errors import InputError
from edgetree.sources.bags.recording import open_recording
from edgetree.sources.bags.rvl import decode_rvl


def with_holes(seed: int, share: float, shape: tuple[int, int] = (48, 64)) -> np.ndarray:
    generator = np.random.default_rng(seed)
    depth = generator.integers(0, 2**16, shape).astype(np.uint16)
    depth[generator.random(shape) < share] = 0
    return depth


@pytest.mark.parametrize(
    "depth",
    [
        with_holes(0, 0.0),
        with_holes(1, 0.3),
        with_holes(2, 0.95),
        np.zeros((48, 64), np.uint16),
        np.full((48, 64), 65535, np.uint16),
        np.array([[7]], np.uint16),
        np.array([[0, 0, 65535, 1, 0, 32768]], np.uint16),
        (np.arange(480 * 640, dtype=np.uint32) // 100).astype(np.uint16).reshape(480, 640),
    ],
)
def test_what_is_written_is_read(depth: np.ndarray) -> None:
    np.testing.assert_array_equal(decode_rvl(rvl(depth)), depth)


def test_the_code_of_a_known_picture() -> None:
    # Two pixels without a reading, three of 5, 7 and 6, and one without.
    # 2, 3; changes 5, 2, -1 as 10, 4, 1; and 1, 0.
    nibbles = [2, 3, 8 | 2, 1, 4, 1, 1, 0]
    word = sum(nibble << (28 - 4 * place) for place, nibble in enumerate(nibbles))
    found = decode_rvl(struct.pack("<iiI", 3, 2, word))
    assert found.tolist() == [[0, 0, 5], [7, 6, 0]]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(8),
        struct.pack("<ii", -1, 48) + bytes(100),
        struct.pack("<ii", 64, 48),
        struct.pack("<ii", 2**31 - 1, 2**31 - 1) + bytes(100),
        struct.pack("<ii", 10_000, 10_000) + bytes(100),  # runs of no pixels
        struct.pack("<ii", 64, 48) + b"\xff" * 400,  # a number that does not end
        struct.pack("<ii", 64, 48) + b"\x77" * 400,
        rvl(with_holes(3, 0.3))[:-200],
    ],
)
def test_code_that_does_not_fit_its_size(data: bytes) -> None:
    start = time.monotonic()
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="RVL"):
            decode_rvl(data)
        assert tracemalloc.get_traced_memory()[1] < 3 * 10**8  # an empty picture of the size
    finally:
        tracemalloc.stop()
    assert time.monotonic() - start < 2


def test_large_code_takes_bounded_memory_and_time() -> None:
    size = struct.pack("<ii", 4000, 4000)
    start = time.monotonic()
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match="RVL"):
            decode_rvl(size + bytes(2 * 10**7))  # runs of no pixels
        assert tracemalloc.get_traced_memory()[1] < 5 * 10**8
    finally:
        tracemalloc.stop()
    assert time.monotonic() - start < 10


def test_pictures_of_several_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    depth = with_holes(5, 0.3)
    depth[20:30] = 1000  # a run of more than a block
    monkeypatch.setattr("edgetree.sources.bags.rvl._BLOCK", 64)
    np.testing.assert_array_equal(decode_rvl(rvl(depth)), depth)


@pytest.mark.parametrize(
    ("form", "header", "transport"),
    [
        ("16UC1; compressedDepth rvl", bytes(12), "/compressedDepth"),
        ("16UC1; compressedDepth RVL", bytes(12), "/compressedDepth"),
        ("16UC1; compressedDepth rvl", bytes(12), ""),
        ("rvl", b"", "/compressed"),
        ("16UC1; rvl", b"", "/compressed"),
        ("rvl", bytes(12), "/compressed"),
        ("rvl", b"DRVL", "/compressed"),
    ],
)
def test_rvl_in_recordings(
    bags: Any, tmp_path: Path, form: str, header: bytes, transport: str
) -> None:
    depth = with_holes(4, 0.2) // 8
    with bags.BagFile(tmp_path) as bag:
        bag.packed(f"/cam/depth{transport}", header + rvl(depth), form, bags.START_NS)
    (frame,) = open_recording(bag.path)
    assert frame.depth_m is not None
    np.testing.assert_array_equal(frame.depth_m, (depth / 1000).astype(np.float32))


def test_quantised_float_depth_in_rvl(bags: Any, tmp_path: Path) -> None:
    scale, offset = 5000.0, 100.0
    depth_m = np.linspace(1, 8, 64 * 48, dtype=np.float32).reshape(48, 64)
    values = np.rint(scale / depth_m + offset).astype(np.uint16)
    header = struct.pack("<iff", 1, scale, offset)
    with bags.BagFile(tmp_path) as bag:
        form = "32FC1; compressedDepth rvl"
        bag.packed("/cam/depth/compressedDepth", header + rvl(values), form, bags.START_NS)
    (frame,) = open_recording(bag.path)
    np.testing.assert_allclose(frame.depth_m, depth_m, rtol=0.01)


def test_the_last_line_says_that_nothing_could_be_decoded(bags: Any, tmp_path: Path) -> None:
    frame = bags.small_frame()
    with bags.BagFile(tmp_path) as bag:
        for number in range(3):
            stamp = bags.START_NS + number * bags.PERIOD_NS
            bag.image(bags.COLOUR, frame.image, stamp)
            code = bytes(12) + rvl(frame.depth)[:100]
            bag.packed(f"{bags.DEPTH}/compressedDepth", code, "16UC1; compressedDepth rvl", stamp)
    with pytest.raises(InputError, match=r"no picture could be decoded \(3 unreadable.*RVL code"):
        list(open_recording(bag.path))
