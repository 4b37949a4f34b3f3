"""Find which kinds of cameras the installed OpenCV can read."""

from __future__ import annotations

from typing import Final

__all__ = ["VIDEO_BACKENDS", "examine_video"]

VIDEO_BACKENDS: Final = {"V4L2": "CAP_V4L2", "FFmpeg": "CAP_FFMPEG", "GStreamer": "CAP_GSTREAMER"}
"""What reads cameras, with the name of its constant in OpenCV: devices of Linux; RTSP, HTTP and
files; pipelines."""


def examine_video() -> dict[str, bool]:
    """Whether the installed OpenCV has each of `VIDEO_BACKENDS`."""
    import cv2

    return {
        name: bool(cv2.videoio_registry.hasBackend(getattr(cv2, constant)))
        for name, constant in VIDEO_BACKENDS.items()
    }
