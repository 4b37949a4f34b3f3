"""Frames: a picture with all that is known about it, its cameras, and its trees and metres."""

from basetree.deprecation import moved_names
from edgetree.frames.frame import Frame, stream_frame
from edgetree.frames.pipeline import FrameResult, process
from edgetree.frames.rig import Rig

__all__ = ["Frame", "FrameResult", "Rig", "process", "stream_frame"]

__getattr__ = moved_names(
    __name__,
    {name: f"edgetree.sources.{name}" for name in ("FrameSource", "open_source")},
)
