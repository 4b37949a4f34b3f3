"""Camera and transform files."""

from __future__ import annotations

from pathlib import Path

import calib
from calib.files.stereo import load_stereo
from formats.form import Format

_ROS = b"""image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [526.69, 0, 312.33, 0, 525.75, 246.22, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.01, -0.02, 0, 0, 0]}
"""
_OPENCV = b"""%YAML:1.0
---
image_width: 1280
image_height: 720
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 905., 0., 640., 0., 904., 362., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ 0.1, -0.2, 0., 0., 0. ]
"""
_XML = b"""<?xml version="1.0"?><opencv_storage><image_width>1280</image_width>
<image_height>720</image_height><cameraMatrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols>
<data>905. 0. 640. 0. 904. 362. 0. 0. 1.</data></cameraMatrix>
<distCoeffs type_id="opencv-matrix"><rows>5</rows><cols>1</cols><data>0.1 0 0 0 0</data>
</distCoeffs></opencv_storage>"""
_KALIBR = b"""cam0: {camera_model: pinhole, intrinsics: [400, 400, 320, 240],
  resolution: [640, 480], distortion_model: equidistant, distortion_coeffs: [0.01, 0, 0, 0]}"""
_ZED = (
    b"[LEFT_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=0.1\nk2=0\n\n"
    b"[LEFT_DISTO]\nk1=0.1\nk2=0\np1=0\np2=0\nk3=0\n"
)
_REALSENSE = b"[ 640x480  p[320 240]  f[600 600]  Brown Conrady [0 0 0 0 0] ]"
_OWN = b'{"schema": "calib.camera/1", "width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320,'
_OWN += b' "cy": 240, "distortion": [0.1, 0, 0, 0]}'
_TRANSFORM = b'{"schema": "calib.transform/1", "translation_m": [0, 0, 1], "roll_pitch_yaw_deg":'
_TRANSFORM += b" [0, 10, 0]}"

_MESSAGE = b"""header: {frame_id: cam}
height: 480
width: 640
distortion_model: None
d: [0, 0, 0, 0, 0]
k: [0, 0, 0, 0, 0, 0, 0, 0, 0]
p: [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]
binning_x: 2
binning_y: 2
roi: {x_offset: 40, y_offset: 30, height: 400, width: 500, do_rectify: false}
"""
_OAK_MESSAGE = b"""height: 180
width: 320
distortion_model: rational_polynomial
d: [0.5, -6.3, 0.002, -2e-4, 5.6, 0.5, -6.3, 5.5, 0.001, 0, 0, 0, -0.02, -0.006]
k: [249, 0, 160, 0, 249, 89, 0, 0, 1]
"""
_OST = b"""[image]

width
640

height
480

[narrow_stereo/left]

camera matrix
500 0 320
0 500 240
0 0 1

distortion
0.1 -0.2 0 0 0

projection
500 0 320 0
0 500 240 0
0 0 1 0
"""
_STEREO = _OPENCV.replace(b"camera_matrix", b"M1").replace(b"distortion_coefficients", b"D1")
_STEREO = _STEREO.replace(b"image_width: 1280\nimage_height: 720\n", b"")
_OAK = b"""{"cameraData": [[0, {"cameraType": 0, "width": 640, "height": 480, "distortionCoeff":
[0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.01, 0], "intrinsicMatrix":
[[500, 0, 320], [0, 500, 240], [0, 0, 1]]}]]}"""
_RECORD3D = b'{"w": 640, "h": 480, "K": [500, 0, 0, 0, 500, 0, 320, 240, 1], "fps": 60}'
_ROWS = b"500.0, 0.0, 320.0\n0.0, 500.0, 180.0\n0.0, 0.0, 1.0\n"
_ZED_PAIR = (
    b"[LEFT_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=-0.17\nk2=0.02\n"
    b"[RIGHT_CAM_HD]\nfx=700\nfy=700\ncx=640\ncy=360\nk1=-0.17\nk2=0.02\n"
    b"[STEREO]\nBaseline=120\nTY=0.1\nTZ=0.1\nRX_HD=0.001\nCV_HD=0.005\nRZ_HD=0.001\n"
)
_COLMAP = b"# cameras\n1 OPENCV 640 480 500 500 320 240 0 0 0 0\n"
_WINDOWS = "# Bäume\n".encode("cp1252") + _ROS
_DEPTH_SCALE = b"""{"schema": "calib.depth_scale/1", "scale": 1.01, "offset_m": -0.02,
"scale_std": 0.002, "offset_std_m": 0.004, "correlation": -0.8, "nearest_m": 1.0,
"farthest_m": 4.0}"""


_STEREO_PAIR = b"""{"schema": "calib.stereo/1", "left": {"width": 640, "height": 480, "fx": 500,
"fy": 500, "cx": 320, "cy": 240, "distortion": []}, "right": {"width": 640, "height": 480,
"fx": 500, "fy": 500, "cx": 320, "cy": 240, "distortion": []}, "right_from_left": {"rotation":
[[1, 0, 0], [0, 1, 0], [0, 0, 1]], "translation_m": [-0.12, 0, 0]}}"""
_CAMCHAIN = (
    _KALIBR
    + b"""
cam1: {camera_model: pinhole, intrinsics: [400, 400, 320, 240], resolution: [640, 480],
  distortion_model: equidistant, distortion_coeffs: [0.01, 0, 0, 0],
  T_cn_cnm1: [[1, 0, 0, -0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}"""
)
_SECOND = _OPENCV.partition(b"camera_matrix")[2].replace(b"distortion_coefficients", b"D2")
_OPENCV_PAIR = (
    _STEREO.rstrip()
    + b"\nM2"
    + _SECOND.rstrip()
    + b"""
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: [ -0.1, 0., 0. ]
"""
)
_KITTI = b"P0: 700 0 600 0 0 700 180 0 0 0 1 0\nP1: 700 0 600 -380 0 700 180 0 0 0 1 0\n"


def _rectified_eye(path: Path) -> object:
    return calib.load_camera(path, name="LEFT_CAM_HD_RECTIFIED")


def _stereo(path: Path) -> object:
    return load_stereo(path).left_rotation


def _any_size(path: Path) -> object:
    return calib.load_camera(path).scaled(640, 360)


_CAMERAS = (
    *(_ROS, _OPENCV, _XML, _KALIBR, _ZED, _REALSENSE, _OWN),
    *(_MESSAGE, _OAK_MESSAGE, _OST, _OAK, _RECORD3D, _WINDOWS),
    _REALSENSE.decode().encode("utf-16"),
)

FORMATS = {
    "camera": Format(_CAMERAS, calib.load_camera),
    "zed.conf": Format((_ZED_PAIR,), _rectified_eye),
    "matrices": Format((_STEREO, _ROWS), _any_size),
    "colmap": Format((_COLMAP,), calib.load_camera, "COLMAP are not read"),
    "depth_scale": Format((_DEPTH_SCALE,), calib.load_depth_scale),
    "stereo": Format((_STEREO_PAIR, _CAMCHAIN, _OPENCV_PAIR, _KITTI), _stereo),
    "transform": Format((_TRANSFORM,), calib.load_transform),
}
