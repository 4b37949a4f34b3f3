"""Camera and transform files."""

from __future__ import annotations

import calib
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

_CAMERAS = (_ROS, _OPENCV, _XML, _KALIBR, _ZED, _REALSENSE, _OWN)

FORMATS = {
    "camera": Format(_CAMERAS, calib.load_camera),
    "transform": Format((_TRANSFORM,), calib.load_transform),
}
