"""Frames: sources of images and depth, cameras, and processing to trees and metres."""

from edgetree.frames.pipeline import FrameResult, process
from edgetree.frames.rig import Rig
from edgetree.frames.sources import Frame, FrameSource, open_source

__all__ = ["Frame", "FrameResult", "FrameSource", "Rig", "open_source", "process"]
