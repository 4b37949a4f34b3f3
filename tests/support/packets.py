"""Encode pictures as packets of video, and depth as RVL."""

from __future__ import annotations

import struct

import numpy as np

ENCODERS = {"h264": "libx264", "hevc": "libx265"}


def moving_pictures(count: int) -> list[np.ndarray]:
    """(64, 96, 3) uint8 BGR pictures of a smooth ground with a bright square that moves."""
    rows, columns = np.mgrid[:64, :96]
    ground = np.stack([rows * 2 + 40, columns + 60, rows + columns + 30], -1).astype(np.uint8)
    pictures = []
    for number in range(count):
        picture = ground.copy()
        picture[16:40, 4 * number : 4 * number + 24] = (40, 220, 230)
        pictures.append(picture)
    return pictures


def video_packets(
    pictures: list[np.ndarray],
    codec: str = "h264",
    *,
    key_every: int = 100,
    b_frames: int = 0,
    profile: str = "high",
) -> list[bytes]:
    """The packets of pictures, each of one picture, the first of a key frame."""
    import av

    height, width = pictures[0].shape[:2]
    encoder = av.CodecContext.create(ENCODERS[codec], "w")
    encoder.width, encoder.height = width, height
    encoder.pix_fmt, encoder.framerate, encoder.gop_size = "yuv420p", 10, key_every
    # libx265 takes its settings in one option, and writes to the terminal without it.
    private = f"keyint={key_every}:bframes={b_frames}:scenecut=0:log-level=none:repeat-headers=1"
    encoder.options = {
        "h264": {
            "crf": "10",
            "bf": str(b_frames),
            "x264-params": "scenecut=0",
            "profile": profile,
        },
        "hevc": {"crf": "10", "x265-params": private},
    }[codec]
    packets = []
    for picture in pictures:
        packets += encoder.encode(av.VideoFrame.from_ndarray(picture, format="bgr24"))
    packets += encoder.encode(None)
    return [bytes(packet) for packet in packets]


def rvl(depth: np.ndarray) -> bytes:
    """The size and RVL code of (H, W) uint16 depth."""
    nibbles: list[int] = []

    def write(number: int) -> None:
        while True:
            group, number = number & 7, number >> 3
            nibbles.append(group | (8 if number else 0))
            if not number:
                return

    values = [int(value) for value in depth.ravel()]
    at, before = 0, 0
    while at < len(values):
        for is_reading in (False, True):
            run = []
            while at < len(values) and (values[at] != 0) is is_reading:
                run.append(values[at])
                at += 1
            write(len(run))
            for value in run if is_reading else ():
                change = value - before
                write((change << 1) ^ (change >> 63))
                before = value
    nibbles += [0] * (-len(nibbles) % 8)
    words = [
        sum(nibble << (28 - 4 * place) for place, nibble in enumerate(nibbles[start : start + 8]))
        for start in range(0, len(nibbles), 8)
    ]
    return struct.pack(f"<ii{len(words)}I", depth.shape[1], depth.shape[0], *words)
