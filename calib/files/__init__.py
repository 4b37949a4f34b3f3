"""Cameras and transforms on disk: the project's own files, and the cameras of other tools."""

from calib.files.cameras import load_camera, save_camera
from calib.files.transforms import load_transform, save_transform

__all__ = ["load_camera", "load_transform", "save_camera", "save_transform"]
