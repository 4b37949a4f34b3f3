"""Cameras and depth: intrinsics, projection, depth encodings, the ground. Knows no trees."""

from calib.camera import PinholeCamera
from calib.depth import DepthEncoding, decode_depth, encode_depth, read_depth, write_depth
from calib.errors import CalibError, CameraError, DepthError, InputFileError
from calib.files import load_camera, save_camera
from calib.ground import CAMERA_UP, GroundPlane, GroundPlaneFailure, fit_ground_plane
from calib.letterbox import Letterbox
from calib.pixels import image_to_opencv, opencv_to_image
from calib.points import depth_to_points, pixels_to_points, pixels_to_rays, project_points

__all__ = [
    "CAMERA_UP",
    "CalibError",
    "CameraError",
    "DepthEncoding",
    "DepthError",
    "GroundPlane",
    "GroundPlaneFailure",
    "InputFileError",
    "Letterbox",
    "PinholeCamera",
    "decode_depth",
    "depth_to_points",
    "encode_depth",
    "fit_ground_plane",
    "image_to_opencv",
    "load_camera",
    "opencv_to_image",
    "pixels_to_points",
    "pixels_to_rays",
    "project_points",
    "read_depth",
    "save_camera",
    "write_depth",
]
