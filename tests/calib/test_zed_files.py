"""ZED factory files: which lens model they mean."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from basetree.errors import InputFileError
from calib import CameraError, PinholeCamera, load_camera, project_points

FIVE = {
    "k1": -0.0552763,
    "k2": 0.0266142,
    "p1": -8.44e-05,
    "p2": -4.29e-04,
    "k3": -0.0108632,
}
RATIONAL = {
    "k1": 1.41658,
    "k2": 0.38421,
    "p1": -1.1e-04,
    "p2": -3.8e-04,
    "k3": 0.0213,
    "k4": 1.47186,
    "k5": 0.46121,
    "k6": 0.03842,
}
FISHEYE = {"k1": -0.0386674, "k2": 0.0304795, "k3": -0.0237575, "k4": 0.0167972}
PADDED = FISHEYE | {"k5": 0, "k6": 0, "p1": 0, "p2": 0}
FOCAL = {"fx": 533.895, "fy": 533.575, "cx": 632.69, "cy": 362.9155}
MATRIX = np.array([[533.895, 0, 632.69], [0, 533.575, 362.9155], [0, 0, 1]])
# Points up to 50 degrees off the axis.
POINTS_M = np.array([[x, y, 1.0] for x in np.linspace(-1.15, 1.15, 9) for y in (-0.65, 0, 0.65)])


def conf(folder: Path, **sections: dict[str, float]) -> Path:
    """Write a factory file."""
    path = folder / "SN31234567.conf"
    text = "".join(
        f"[{name}]\n" + "".join(f"{key}={value}\n" for key, value in fields.items()) + "\n"
        for name, fields in sections.items()
    )
    path.write_text(text + "[STEREO]\nBaseline=119.905\nTY=-0.0259\nCV_HD=0.00133\n")
    return path


def projected(camera: PinholeCamera) -> np.ndarray:
    """Project as OpenCV does, pixel centres on whole numbers."""
    return project_points(camera, POINTS_M) - 0.5


def by_opencv(terms: dict[str, float]) -> np.ndarray:
    """Project with OpenCV's radial-tangential model, or its fisheye model if there is no p1."""
    order = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    lens = np.array([terms[name] for name in order if name in terms])
    project = cv2.projectPoints if "p1" in terms else cv2.fisheye.projectPoints
    return project(POINTS_M[:, None], np.zeros(3), np.zeros(3), MATRIX, lens)[0].reshape(-1, 2)


@pytest.mark.parametrize(
    ("section", "lens", "model"),
    [
        (FIVE, None, FIVE),  # ZED, ZED Mini
        (FIVE, RATIONAL, RATIONAL),  # ZED 2: the section's terms are for older programs
        ({}, RATIONAL, RATIONAL),  # ZED X
        (FIVE, FISHEYE, FISHEYE),
        ({}, PADDED, FISHEYE),  # ZED X with fisheye lenses
        (FIVE, PADDED, FISHEYE),
        (FIVE, FISHEYE | {"p1": 0, "p2": 0}, FISHEYE),
        (FIVE, RATIONAL | {"k3": 0, "k4": 0}, RATIONAL | {"k3": 0, "k4": 0}),
        (FISHEYE, None, FISHEYE),  # ZED Mini since 2022
        (PADDED, None, FISHEYE),
        ({}, FIVE | {"k4": 0, "k5": 0, "k6": 0}, FIVE),
        (RATIONAL, None, RATIONAL),
        (FIVE, RATIONAL | {"p1": 0, "p2": 0}, RATIONAL | {"p1": 0, "p2": 0}),
    ],
)
def test_a_lens_is_one_whole_model_and_projects_as_opencv(
    tmp_path: Path,
    section: dict[str, float],
    lens: dict[str, float] | None,
    model: dict[str, float],
) -> None:
    lenses = {} if lens is None else {"LEFT_DISTO": lens, "RIGHT_DISTO": dict.fromkeys(lens, 0.1)}
    path = conf(tmp_path, LEFT_CAM_HD=FOCAL | section, RIGHT_CAM_HD=FOCAL | section, **lenses)
    camera = load_camera(path, name="LEFT_CAM_HD")
    assert (camera.width, camera.height) == (1280, 720)
    np.testing.assert_allclose(projected(camera), by_opencv(model), atol=1e-6)


def test_files_of_cameras_with_one_eye_are_read(tmp_path: Path) -> None:
    path = conf(tmp_path, CAM_4k=FOCAL | {"cx": 1900.0, "cy": 1080.0}, CAM_FHD=FOCAL, DISTO=PADDED)
    assert load_camera(path, name="CAM_4k") == PinholeCamera(
        3840, 2160, 533.895, 533.575, 1900.0, 1080.0, tuple(FISHEYE.values()), "fisheye"
    )
    with pytest.raises(InputFileError, match="expected one of the names 'CAM_4k', 'CAM_FHD'"):
        load_camera(path)


@pytest.mark.parametrize(
    ("section", "lens", "message"),
    [
        (FIVE, {"k1": 0.6}, "LEFT_DISTO has no k2, p1, p2, k3: expected k1 to k6"),
        (
            FIVE,
            {"k1": 0.6, "k2": 0.1, "k3": 0, "k4": 0.1, "p1": 0},
            "LEFT_DISTO has k4 0.1 without k3",
        ),
        (FIVE, {"k1": 0.6, "k2": 0.1, "k3": 0, "k4": 0.1, "p1": 1e-4}, "no p2, k5, k6: expected"),
        (
            {},
            PADDED | {"k3": 0},
            "LEFT_DISTO has k4 0.0167972 without k3, p1, p2, k5 and k6, which",
        ),
        (FISHEYE | {"k3": 0}, None, "the section has k4 0.0167972 without k3"),
        (
            FIVE,
            dict.fromkeys(RATIONAL, 0),
            "the terms of LEFT_DISTO are 0 and those of the section",
        ),
        (FIVE, RATIONAL | {"s1": 0.1}, "s1 is 0.1: expected no thin prism"),
        ({}, None, "the section has no k1, k2: expected k1 to k6"),
    ],
)
def test_a_lens_of_no_clear_model_is_refused(
    tmp_path: Path, section: dict[str, float], lens: dict[str, float] | None, message: str
) -> None:
    lenses = {} if lens is None else {"LEFT_DISTO": lens}
    path = conf(tmp_path, LEFT_CAM_HD=FOCAL | section, **lenses)
    with pytest.raises(CameraError) as caught:
        load_camera(path)
    assert str(caught.value).startswith(f"{path} (LEFT_CAM_HD): ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


PAIR = """
[LEFT_CAM_HD]
fx=700.8
fy=700.6
cx=652.1
cy=371.4
k1=-0.172
k2=0.026
[RIGHT_CAM_HD]
fx=699.4
fy=699.1
cx=641.7
cy=363.9
k1=-0.174
k2=0.027
[STEREO]
Baseline=119.96
TY=0.11
TZ_HD=-0.32
CV_HD=0.0097
RX_HD=-0.0031
RZ_HD=0.0012
"""


def maps_of(camera: PinholeCamera, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Where the rectified pixels of an eye of PAIR lie in its raw picture."""
    matrices = [
        np.array([[700.8, 0, 652.1], [0, 700.6, 371.4], [0, 0, 1]]),
        np.array([[699.4, 0, 641.7], [0, 699.1, 363.9], [0, 0, 1]]),
    ]
    terms = [np.array([-0.172, 0.026, 0, 0]), np.array([-0.174, 0.027, 0, 0])]
    rotation = cv2.Rodrigues(np.array([-0.0031, 0.0097, 0.0012]))[0]
    translation = np.array([[119.96], [0.11], [-0.32]])
    size = (1280, 720)
    turned = cv2.stereoRectify(
        matrices[0], terms[0], matrices[1], terms[1], size, rotation, translation
    )[index]
    own = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
    return cv2.initUndistortRectifyMap(
        matrices[index], terms[index], turned, own, size, cv2.CV_32FC1
    )


@pytest.mark.parametrize(("name", "index"), [("LEFT", 0), ("RIGHT", 1)])
def test_the_rectified_pictures_of_a_pair_have_a_camera_of_their_own(
    tmp_path: Path, name: str, index: int, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "SN1.conf"
    path.write_text(PAIR)
    camera = load_camera(path, name=f"{name}_CAM_HD_RECTIFIED")
    assert camera.distortion == ()
    assert camera.fx == camera.fy
    assert "are computed from both eyes" in caplog.text
    x, y = maps_of(camera, index)  # zoomed until every pixel is one of the raw picture, and no more
    inside = (x.min() > -1, x.max() < 1280, y.min() > -1, y.max() < 720)
    assert all(inside)
    margins = (x.min(), 1279 - x.max(), y.min(), 719 - y.max())
    assert min(margins) < 25


def test_both_rectified_eyes_have_the_same_lens(tmp_path: Path) -> None:
    path = tmp_path / "SN1.conf"
    path.write_text(PAIR)
    left, right = (load_camera(path, name=f"{eye}_CAM_HD_RECTIFIED") for eye in ("LEFT", "RIGHT"))
    assert left == right


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PAIR.replace("[RIGHT_CAM_HD]", "[RIGHT_CAM_VGA]"), "has no camera 'LEFT_CAM_HD_RECTIFI"),
        (PAIR.replace("Baseline", "Line"), "has no camera 'LEFT_CAM_HD_RECTIFIED'"),
        (PAIR.replace("=119.96", "=0"), "expected finite numbers, and a baseline"),
        (PAIR.replace("=0.0097", "=nan"), "expected finite numbers, and a baseline"),
        (PAIR.replace("=0.0097", "=wide"), "cv_hd is 'wide': expected a number"),
        (PAIR.replace("k2=0.027", "k2=0.02\nk3=0.01\nk4=0.01"), "the eyes are fisheye lenses"),
        (PAIR.replace("=0.0097", "=1.5"), "the eyes are turned by 85.9 degrees"),
        (PAIR.replace("=0.11", "=1e300"), "expected finite numbers, and a baseline"),
    ],
)
def test_a_pair_that_cannot_be_rectified_is_refused(
    tmp_path: Path, text: str, message: str
) -> None:
    path = tmp_path / "SN1.conf"
    path.write_text(text)
    with pytest.raises((CameraError, InputFileError)) as caught:
        load_camera(path, name="LEFT_CAM_HD_RECTIFIED")
    assert message in str(caught.value)
