"""Frames with what their source does not know: the camera and the vertical of the rig."""

from __future__ import annotations

from dataclasses import replace

from edgetree.frames.rig import Rig
from edgetree.live.frames import LiveFrame
from edgetree.live.sources.arrays import unit_vector

__all__ = ["completed"]


def completed(frame: LiveFrame, rig: Rig, width: int, height: int) -> LiveFrame:
    """The frame with the rig's camera and vertical, where its source does not know them.

    Args:
        frame: the frame.
        rig: the camera and the vertical.
        width: width of the frame, px.
        height: height of the frame, px.

    Raises:
        CameraError: the rig's camera is of another shape.
    """
    up_camera = frame.up_camera
    if up_camera is None and rig.up_camera is not None:
        up_camera = unit_vector(rig.up_camera)
    return replace(frame, camera=frame.camera or rig.camera_for(width, height), up_camera=up_camera)
