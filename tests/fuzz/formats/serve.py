"""Messages to the service of `edgetree live --serve`: a line of JSON, and then pixels."""

from __future__ import annotations

import json
from pathlib import Path

from edgetree.frames.rig import Rig
from edgetree.serve.handed import HandedFrame, inline_pixels, size_bytes
from edgetree.serve.messages import FrameMessage, read_message
from edgetree.serve.shared_memory import FOLDER, IS_THERE, OpenMemories
from formats.form import Format

_NAME = "/edgetree-fuzz"
_SIZE = {"width": 4, "height": 2}
_FRAME = {
    "schema": "edgetree.serve.frame/1",
    "id": 7,
    "time_s": 0.5,
    "colour": _SIZE,
    "depth": {**_SIZE, "format": "uint16", "scale_m": 0.001, "kind": "range"},
    "camera": {**_SIZE, "fx": 3.0, "fy": 3.0, "cx": 1.5, "cy": 0.5, "distortion": [0, 0, 0, 0]},
    "up_camera": [0.0, -1.0, 0.1],
    "pose": {"rotation": [[1, 0, 0], [0, 0, 1], [0, -1, 0]], "translation_m": [1, 2, 3]},
}
_INLINE = json.dumps(_FRAME).encode() + b"\n" + bytes(range(24)) + bytes(16)
_MEMORY = {**_FRAME, "depth": None, "colour": {**_SIZE, "memory": {"name": _NAME, "offset": 2}}}
_SHARED = json.dumps(_MEMORY).encode() + b"\n" + bytes(26)
_WATCH = b'{"schema": "edgetree.serve.watch/1"}\n'


def _frame(path: Path) -> object:
    """The frame of a message, whose pixels are cut to the sizes that it states."""
    text, _, pixels = path.read_bytes().partition(b"\n")
    message = read_message(text)
    if not isinstance(message, FrameMessage):
        return message
    images = [image for image in (message.colour, message.depth) if image is not None]
    if IS_THERE and any(image.memory is not None for image in images):
        return _from_memory(images, pixels)
    first = size_bytes(images[0]) if images else 0
    parts = [pixels[:first], pixels[first:]][: len(images)]
    colour, depth = inline_pixels(message, parts)
    return HandedFrame(0, message, colour, depth).frame(Rig())


def _from_memory(images: list, pixels: bytes) -> object:
    (FOLDER / _NAME.removeprefix("/")).write_bytes(pixels)
    memories = OpenMemories()
    try:
        inline = FrameMessage(0, 0.0, colour=images[0])
        inline_pixels(inline, [] if images[0].memory else [pixels])
        return [memories.read(image) for image in images if image.memory is not None]
    finally:
        memories.close()
        (FOLDER / _NAME.removeprefix("/")).unlink(missing_ok=True)


FORMATS = {"handed": Format((_INLINE, _SHARED, _WATCH), _frame)}
