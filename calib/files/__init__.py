"""Read and write camera and transform files, including the camera files of other tools."""

from calib.files.cameras import load_camera, save_camera
from calib.files.transforms import load_transform, save_transform

__all__ = ["load_camera", "load_transform", "save_camera", "save_transform"]
