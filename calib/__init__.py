"""Cameras and depth: intrinsics, distortion, files, depth maps and the ground plane.

General-purpose: nothing here is specific to trees. Lengths are metres. Camera coordinates are x
right, y down, z forward. Image coordinates are continuous pixels: (0, 0) is the outer corner of the
first pixel, whose centre is (0.5, 0.5).
"""

from basetree.deprecation import moved_names
from calib.boxes import box_iou
from calib.camera import PinholeCamera
from calib.depth import (
    DepthConvention,
    DepthEncoding,
    DepthFailure,
    DepthKind,
    DepthReport,
    check_depth,
    decode_depth,
    depth_to_disparity,
    depth_to_range,
    disparity_to_depth,
    encode_depth,
    mask_by_confidence,
    range_to_depth,
    read_depth,
    write_depth,
)
from calib.depth_scale import DepthScale, load_depth_scale, save_depth_scale
from calib.depth_scale_fit import DepthScaleFailure, TargetReadings, fit_depth_scale, read_target
from calib.directions import CAMERA_UP
from calib.errors import CameraError, CloudError, DepthError
from calib.files import load_camera, load_transform, save_camera, save_transform
from calib.ground import GroundPlane, GroundPlaneFailure, fit_ground_plane, fit_ground_planes
from calib.labels import CocoLabels
from calib.letterbox import Letterbox
from calib.masks import CocoRle, encode_rle, mask_polygons, paste_mask
from calib.picture_statistics import picture_statistics, usual_ranges
from calib.pixels import image_to_opencv, opencv_to_image
from calib.points import depth_to_points, pixels_to_points, pixels_to_rays, project_points
from calib.rectify import Rectification, rectify
from calib.registration import register_depth
from calib.transform import RigidTransform

__all__ = [
    "CAMERA_UP",
    "CameraError",
    "CloudError",
    "CocoLabels",
    "CocoRle",
    "DepthConvention",
    "DepthEncoding",
    "DepthError",
    "DepthFailure",
    "DepthKind",
    "DepthReport",
    "DepthScale",
    "DepthScaleFailure",
    "GroundPlane",
    "GroundPlaneFailure",
    "Letterbox",
    "PinholeCamera",
    "Rectification",
    "RigidTransform",
    "TargetReadings",
    "box_iou",
    "check_depth",
    "decode_depth",
    "depth_to_disparity",
    "depth_to_points",
    "depth_to_range",
    "disparity_to_depth",
    "encode_depth",
    "encode_rle",
    "fit_depth_scale",
    "fit_ground_plane",
    "fit_ground_planes",
    "image_to_opencv",
    "load_camera",
    "load_depth_scale",
    "load_transform",
    "mask_by_confidence",
    "mask_polygons",
    "opencv_to_image",
    "paste_mask",
    "picture_statistics",
    "pixels_to_points",
    "pixels_to_rays",
    "project_points",
    "range_to_depth",
    "read_depth",
    "read_target",
    "rectify",
    "register_depth",
    "save_camera",
    "save_depth_scale",
    "save_transform",
    "usual_ranges",
    "write_depth",
]

__getattr__ = moved_names(
    __name__,
    {
        "CalibError": "basetree.errors.InputError",
        "InputFileError": "basetree.errors.InputFileError",
        "Limits": "basetree.files.Limits",
        "check_picture_size": "basetree.files.check_picture_size",
        "current_limits": "basetree.files.current_limits",
        "picture_size": "basetree.files.picture_size",
        "set_limits": "basetree.files.set_limits",
    },
)
