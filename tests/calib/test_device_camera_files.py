"""Camera files of calibration tools and devices."""

import json
from pathlib import Path
from typing import Any

import pytest
from camera_files import assert_recognised, assert_refused

from calib import PinholeCamera, load_camera

KALIBR = """\
cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
  distortion_model: radtan
  intrinsics: [461.629, 460.152, 362.680, 246.049]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [0.99998854, 0.00216014, 0.00427195, -0.11003785]
  - [-0.00221074, 0.99992702, 0.01187697, 0.00045792]
  - [-0.00424598, -0.01188627, 0.99992034, -0.00064487]
  - [0.0, 0.0, 0.0, 1.0]
  camera_model: pinhole
  distortion_coeffs: [-0.0347, -0.01, 0.0072, -0.0024]
  distortion_model: equidistant
  intrinsics: [378.8, 378.5, 505.8, 509.5]
  resolution: [1024, 1024]
cam2:
  camera_model: omni
  distortion_coeffs: [-0.33518750, 0.13211436, 0.00055967, 0.00057686]
  distortion_model: radtan
  intrinsics: [0.80065662, 833.006, 830.345, 373.850, 253.749]
  resolution: [752, 480]
"""
KALIBR_CAMERA = PinholeCamera(
    752, 480, 461.629, 460.152, 362.68, 246.049, (-0.27695497, 0.06712482, 0.00087538, 0.00011556)
)

CAMODOCAL = """\
%YAML:1.0
---
model_type: PINHOLE
camera_name: camera
image_width: 752
image_height: 480
distortion_parameters:
   k1: -2.9e-01
   k2: 8.3e-02
   p1: 1.8e-04
   p2: -2.8e-05
projection_parameters:
   fx: 4.616e+02
   fy: 4.603e+02
   cx: 3.63e+02
   cy: 2.481e+02
"""
KANNALA = """\
%YAML:1.0
---
model_type: KANNALA_BRANDT
camera_name: front
image_width: 1280
image_height: 1024
projection_parameters:
   k2: -1.2e-02
   k3: 4.0e-03
   k4: -3.0e-03
   k5: 5.0e-04
   mu: 6.1e+02
   mv: 6.09e+02
   u0: 6.32e+02
   v0: 5.2e+02
"""

REALSENSE = """\
Device info:
    Name                          : \tIntel RealSense D435

 Intrinsic Parameters:

 Intrinsic of "Depth" / 848x480 / {Z16}
  Width:      \t848
  Height:     \t480
  PPX:        \t425.271423339844
  PPY:        \t237.838577270508
  Fx:         \t423.171264648438
  Fy:         \t423.171264648438
  Distortion: \tBrown Conrady
  Coeffs:     \t0  \t0  \t0  \t0  \t0  \t
  FOV (deg):  \t90.11 x 59.12

 Intrinsic of "Color" / 640x480 / {YUYV/RGB8/BGR8/RGBA8/BGRA8/Y8}
  Width:      \t640
  Height:     \t480
  PPX:        \t326.660308837891
  PPY:        \t247.326507568359
  Fx:         \t386.740875244141
  Fy:         \t386.278381347656
  Distortion: \tInverse Brown Conrady
  Coeffs:     \t-0.0556738  \t0.0655610  \t-0.00033999  \t0.000355891  \t-0.0213657
  FOV (deg):  \t79.2 x 63.69
"""
REALSENSE_PRINTED = (
    "[ 640x480  p[313.947 236.609]  f[612.916 613.482]  Inverse Brown Conrady [0 0 0 0 0] ]\n"
)
# Older versions of pyrealsense2
REALSENSE_PRINTED_OLD = (
    "width: 640, height: 480, ppx: 313.947, ppy: 236.609, fx: 612.916, fy: 613.482,"
    " model: Brown Conrady, coeffs: [0.1, -0.2, 0.001, 0.002, 0.03]\n"
)
REALSENSE_JSON: dict[str, Any] = {
    "width": 848,
    "height": 480,
    "fx": 423.1,
    "fy": 423.2,
    "ppx": 425.3,
    "ppy": 237.8,
    "model": "distortion.brown_conrady",
    "coeffs": [0.1, -0.2, 0.001, 0.002, 0.03],
}
REALSENSE_CAMERA = PinholeCamera(
    848, 480, 423.1, 423.2, 425.3, 237.8, (0.1, -0.2, 0.001, 0.002, 0.03)
)

ZED = """\
[LEFT_CAM_HD]
fx=701.88
fy=701.7
cx=641.285
cy=344.1835
k1=-0.175286
k2=0.0283094
p1=6.68414e-05
p2=-0.000150431
k3=4.06032e-11

[RIGHT_CAM_HD]
fx=700.965
fy=701.11
cx=633.515
cy=359.3135
k1=-0.172795
k2=0.0265223
k3=0

[LEFT_CAM_VGA]
fx=350.94
fy=350.85
cx=336.1425
cy=179.59175
k1=-0.175286
k2=0.0283094

[STEREO]
Baseline=119.978
TY=0.0259812
RX_HD=-0.000916611
"""
ZED_X = """\
[LEFT_CAM_FHD1200]
fx = 950.1
fy = 951.2
cx = 960.5
cy = 600.5
[RIGHT_CAM_SVGA]
fx = 475
fy = 476
cx = 480
cy = 300
[LEFT_DISTO]
k1 = 0.6
k2 = 0.1
p1 = 0.001
p2 = -0.001
k3 = 0.01
k4 = 0.7
k5 = 0.15
k6 = 0.02
[RIGHT_DISTO]
k1 = -0.03
k2 = 0.01
k3 = -0.01
k4 = 0.002
"""

HD = PinholeCamera(
    1280,
    720,
    701.88,
    701.7,
    641.285,
    344.1835,
    (-0.175286, 0.0283094, 6.68414e-05, -0.000150431, 4.06032e-11),
)
KNOWN = [
    ("camchain.yaml", KALIBR, "cam0", KALIBR_CAMERA),
    (
        "camchain.yaml",
        KALIBR,
        "cam1",
        PinholeCamera(
            1024, 1024, 378.8, 378.5, 505.8, 509.5, (-0.0347, -0.01, 0.0072, -0.0024), "fisheye"
        ),
    ),
    (
        "camera.yaml",
        CAMODOCAL,
        None,
        PinholeCamera(752, 480, 461.6, 460.3, 363, 248.1, (-0.29, 0.083, 1.8e-4, -2.8e-5)),
    ),
    (
        "camera.yaml",
        KANNALA,
        "front",
        PinholeCamera(1280, 1024, 610, 609, 632, 520, (-0.012, 0.004, -0.003, 5e-4), "fisheye"),
    ),
    (
        "realsense.txt",
        REALSENSE,
        "Depth 848x480",
        PinholeCamera(
            848, 480, 423.171264648438, 423.171264648438, 425.271423339844, 237.838577270508
        ),
    ),
    (
        "realsense.txt",
        REALSENSE.replace(" / ", "   ").replace("\n  ", "\n"),
        "Depth 848x480",
        PinholeCamera(
            848, 480, 423.171264648438, 423.171264648438, 425.271423339844, 237.838577270508
        ),
    ),
    (
        "printed.txt",
        REALSENSE_PRINTED,
        None,
        PinholeCamera(640, 480, 612.916, 613.482, 313.947, 236.609),
    ),
    (
        "realsense.json",
        json.dumps(REALSENSE_JSON),
        None,
        REALSENSE_CAMERA,
    ),
    (
        "realsense.json",
        json.dumps({"left": REALSENSE_JSON, "right": REALSENSE_JSON}),
        "right",
        REALSENSE_CAMERA,
    ),
    (
        "realsense.json",
        json.dumps({"serial": "1234", "intrinsics": REALSENSE_JSON}),
        None,
        REALSENSE_CAMERA,
    ),
    (
        "realsense.json",
        json.dumps({"color": {"intrinsics": REALSENSE_JSON}, "depth": {"intrinsics": {"ppx": 1}}}),
        "color.intrinsics",
        REALSENSE_CAMERA,
    ),
    (
        "realsense.json",
        json.dumps(
            {
                **{name: value for name, value in REALSENSE_JSON.items() if name != "model"},
                "distortion_model": "distortion.brown_conrady",
            }
        ),
        None,
        REALSENSE_CAMERA,
    ),
    (
        "printed.txt",
        REALSENSE_PRINTED_OLD,
        None,
        PinholeCamera(
            640, 480, 612.916, 613.482, 313.947, 236.609, (0.1, -0.2, 0.001, 0.002, 0.03)
        ),
    ),
    (
        "printed.txt",
        REALSENSE_PRINTED * 2 + REALSENSE_PRINTED.replace("612.916", "600.0"),
        "640x480 Inverse Brown Conrady 2",
        PinholeCamera(640, 480, 600.0, 613.482, 313.947, 236.609),
    ),
    ("SN1234.conf", ZED, "LEFT_CAM_HD", HD),
    (
        "SN1234.conf",
        ZED,
        "RIGHT_CAM_HD",
        PinholeCamera(
            1280, 720, 700.965, 701.11, 633.515, 359.3135, (-0.172795, 0.0265223, 0, 0, 0)
        ),
    ),
    (
        "SN1234.conf",
        ZED,
        "LEFT_CAM_VGA",
        PinholeCamera(
            672, 376, 350.94, 350.85, 336.1425, 179.59175, (-0.175286, 0.0283094, 0, 0, 0)
        ),
    ),
    (
        "SN4567.conf",
        ZED_X,
        "LEFT_CAM_FHD1200",
        PinholeCamera(
            1920, 1200, 950.1, 951.2, 960.5, 600.5, (0.6, 0.1, 0.001, -0.001, 0.01, 0.7, 0.15, 0.02)
        ),
    ),
    (
        "SN4567.conf",
        ZED_X,
        "RIGHT_CAM_SVGA",
        PinholeCamera(960, 600, 475, 476, 480, 300, (-0.03, 0.01, -0.01, 0.002), "fisheye"),
    ),
]


@pytest.mark.parametrize(("file", "text", "name", "expected"), KNOWN)
def test_known_files_are_recognised_by_their_content(
    tmp_path: Path, file: str, text: str, name: str | None, expected: PinholeCamera
) -> None:
    assert_recognised(tmp_path, file, text, name, expected)


REALSENSE_UNNAMED = {name: value for name, value in REALSENSE_JSON.items() if name != "model"}
REALSENSE_INVERSE = {**REALSENSE_JSON, "model": "distortion.inverse_brown_conrady"}
BROKEN = [
    # several cameras, or none of that name
    (KALIBR, None, "holds 3 cameras, expected one of the names 'cam0', 'cam1', 'cam2'"),
    (KALIBR, "cam7", "has no camera 'cam7', expected one of 'cam0', 'cam1', 'cam2'"),
    (REALSENSE, None, "expected one of the names 'Depth 848x480', 'Color 640x480'"),
    (ZED, None, "expected one of the names 'LEFT_CAM_HD', 'RIGHT_CAM_HD', 'LEFT_CAM_VGA'"),
    (
        json.dumps({"intrinsics": {"color": REALSENSE_JSON, "depth": REALSENSE_JSON}}),
        None,
        "expected one of the names 'intrinsics.color', 'intrinsics.depth'",
    ),
    # unsupported camera models
    (json.dumps({**REALSENSE_JSON, "model": "distortion.none"}), None, "expected terms of 0"),
    (json.dumps(REALSENSE_UNNAMED), None, "model or distortion or distortion_model is missing"),
    (KALIBR, "cam2", "(cam2): camera_model is 'omni': expected pinhole"),
    (KALIBR.replace("radtan", "fov"), "cam0", "distortion_model is 'fov': expected radtan"),
    (KANNALA.replace("KANNALA_BRANDT", "MEI"), None, "model_type is 'MEI': expected PINHOLE"),
    (REALSENSE, "Color 640x480", "the model is Inverse Brown Conrady with terms"),
    (REALSENSE_PRINTED.replace("[0 0 0 0 0]", "[0.1 0 0 0 0]"), None, "expected Brown Conrady"),
    (json.dumps(REALSENSE_INVERSE), None, "expected Brown Conrady"),
    (json.dumps({**REALSENSE_JSON, "model": "ftheta"}), None, "model is 'ftheta': expected none"),
    (ZED.replace("k3=4.06032e-11", "s1=0.1"), "LEFT_CAM_HD", "s1 is 0.1: expected no thin prism"),
    # missing fields, or values that are not numbers
    (ZED.replace("k1=-0.175286\n", ""), "LEFT_CAM_HD", "the section has no k1: expected k1 to k6"),
    (ZED.replace("fx=701.88", "fx=a"), "LEFT_CAM_HD", "fx is 'a': expected a number"),
    (KANNALA.replace("   mu: 6.1e+02\n", ""), None, "mu is missing: expected a number"),
    (CAMODOCAL.replace("distortion_parameters", "distortion"), None, "distortion_parameters is"),
    (json.dumps({**REALSENSE_JSON, "coeffs": None}), None, "coeffs is None: expected a list"),
    # contradictory fields
    (KALIBR.replace("[752, 480]", "[752]"), "cam0", "resolution is [752.0]: expected width"),
    (KALIBR.replace("[461.629, ", "["), "cam0", "intrinsics has 3 numbers: expected fu, fv"),
    (KALIBR.replace("[-0.27695497, ", "["), "cam0", "distortion_coeffs has 3 terms: expected 4"),
    (REALSENSE.replace("Width:      \t848", "Width: 640"), "Depth 848x480", "640x480 and 848x480"),
]


@pytest.mark.parametrize(("text", "name", "message"), BROKEN)
def test_broken_and_contradictory_files_get_one_line(
    tmp_path: Path, text: str, name: str | None, message: str
) -> None:
    assert_refused(tmp_path, text, name, message)


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "cp1252", "latin-1"])
def test_texts_of_windows_are_read(tmp_path: Path, encoding: str) -> None:
    path = tmp_path / "cam.txt"
    path.write_bytes(f"# Kamera für Bäume\n{REALSENSE}".replace("\n", "\r\n").encode(encoding))
    plain = tmp_path / "plain.txt"
    plain.write_text(REALSENSE)
    name = "Depth 848x480"
    assert load_camera(path, name=name) == load_camera(plain, name=name)
