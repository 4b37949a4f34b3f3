"""Where results go: JSON lines, and drawn pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, TextIO

import cv2

from edgetree.draw import draw_trees, picture_of_depth
from edgetree.errors import InputError
from edgetree.labels import tree_labels
from edgetree.outputs import replacing
from edgetree.pipeline import FrameResult

__all__ = ["write_json_line", "write_picture"]


def write_json_line(stream: TextIO, record: dict[str, Any]) -> None:
    """Write one record on one line, at once, so that a program that reads along gets it now."""
    stream.write(json.dumps(record, allow_nan=False) + "\n")
    stream.flush()


def write_picture(folder: Path, result: FrameResult) -> Path:
    """Draw a frame's trees with their labels into `folder`.

    Returns:
        The file, named after the frame: `<name>_trees.jpg`.

    Raises:
        InputError: it cannot be written.
    """
    frame = result.frame
    picture = frame.image
    if picture is None and frame.depth_m is not None:
        picture = picture_of_depth(frame.depth_m)
    if picture is None:
        raise InputError(f"frame {frame.name} has neither image nor depth: nothing to draw on")
    labels = tree_labels(result.trees, result.measurements)
    drawn = draw_trees(picture, result.trees, labels)
    _, data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, 92])
    path = folder / f"{frame.name}_trees.jpg"
    with replacing(path) as temporary:
        temporary.write_bytes(data.tobytes())
    return path
