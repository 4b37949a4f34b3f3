"""Depth from two pictures, and the files of their calibration."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import phone_captures
import pytest
from textured_pair import BASELINE_M, CAMERA, bent_pair, pictures

from basetree.errors import InputError
from calib import CameraError, PinholeCamera, RigidTransform
from calib.files.stereo import load_stereo, save_stereo
from calib.sizeless import sizeless_camera
from calib.stereo import StereoPair


@pytest.mark.parametrize("turned", [False, True])
def test_depth_is_that_of_the_rectified_left_camera(turned: bool) -> None:
    pair = bent_pair(turned=turned)
    rectified = pair.rectified
    assert rectified.baseline_m == pytest.approx(BASELINE_M, rel=1e-3)
    found = rectified.depth(*pictures(pair))
    turn = RigidTransform(rectified.rotation, np.zeros(3)).inverse()
    pose = turn.then(phone_captures.mounting(0))
    exact_m, stem = phone_captures.cast(rectified.camera, pose)
    both = (found.depth_m > 0) & (exact_m > 0)
    assert both[stem].mean() > 0.9
    error = (found.depth_m - exact_m)[both] * rectified.focal_baseline / exact_m[both] ** 2
    assert abs(np.median(error)) < 0.02  # px of disparity
    off = (found.depth_m - exact_m)[both] / found.std_m[both]
    assert 0.6 < np.median(np.abs(off)) / 0.6745 < 1.4
    assert not (found.depth_m > 0)[exact_m == 0].mean() > 0.1


def test_deviations_grow_where_texture_fades() -> None:
    pair = bent_pair(turned=False)
    left, right = pictures(pair)
    faint = [np.clip(128 + (each.astype(float) - 128) / 4, 0, 255) for each in (left, right)]
    rng = np.random.default_rng(1)
    noisy = [np.rint(each + rng.normal(0, 2, each.shape[:2])[..., None]) for each in faint]
    weak = pair.rectified.depth(*(np.clip(each, 0, 255).astype(np.uint8) for each in noisy))
    strong = pair.rectified.depth(left, right)
    both = (weak.depth_m > 0) & (strong.depth_m > 0)
    assert np.median(weak.std_m[both]) > 1.5 * np.median(strong.std_m[both])


def test_pictures_of_nothing_in_common_give_no_depth() -> None:
    pair = bent_pair(turned=False)
    rng = np.random.default_rng(1000)
    one, other = rng.integers(0, 255, (2, CAMERA.height, CAMERA.width, 3)).astype(np.uint8)
    assert (pair.rectified.depth(one, other).depth_m > 0).mean() < 0.02


@pytest.mark.parametrize(
    ("translation", "words"),
    [
        ([-120.0, 0, 0], "are they millimetres"),
        ([0.12, 0, 0], "to the left of the left one"),
        ([-0.12, 0.3, 0], "expected cameras side by side"),
        ([0.0, 0, 0], r"stands -?0 m beside"),
    ],
)
def test_cameras_that_are_no_pair_are_refused(translation: list[float], words: str) -> None:
    with pytest.raises(CameraError, match=words):
        StereoPair(CAMERA, CAMERA, RigidTransform(np.eye(3), np.array(translation)))


def same(one: StereoPair, other: StereoPair) -> bool:
    return (
        (one.left, one.right) == (other.left, other.right)
        and np.allclose(one.right_from_left.rotation, other.right_from_left.rotation, atol=1e-9)
        and np.allclose(one.right_from_left.translation_m, other.right_from_left.translation_m)
    )


def test_the_own_file_keeps_all(tmp_path: Path) -> None:
    pair = bent_pair()
    save_stereo(tmp_path / "pair.json", pair)
    assert same(load_stereo(tmp_path / "pair.json"), pair)


def kalibr(pair: StereoPair) -> str:
    matrix = np.eye(4)
    matrix[:3, :3] = pair.right_from_left.rotation
    matrix[:3, 3] = pair.right_from_left.translation_m
    cameras = []
    for name, camera in (("cam0", pair.left), ("cam1", pair.right)):
        terms = camera.distortion or (0.0,) * 4
        lines = [
            f"{name}:",
            "  camera_model: pinhole",
            "  distortion_model: radtan",
            f"  distortion_coeffs: {list(terms)}",
            f"  intrinsics: {[camera.fx, camera.fy, camera.cx, camera.cy]}",
            f"  resolution: {[camera.width, camera.height]}",
        ]
        lines += ["  T_cn_cnm1:", *(f"  - {row}" for row in matrix.tolist())] * (name == "cam1")
        cameras += lines
    return "\n".join(cameras)


def opencv_matrix(name: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    data = ", ".join(repr(float(each)) for each in values.ravel())
    return (
        f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [{data}]"
    )


def opencv(pair: StereoPair) -> tuple[str, str]:
    parts = []
    for side, camera in (("1", pair.left), ("2", pair.right)):
        matrix = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]])
        terms = np.array([[*(camera.distortion or (0.0,) * 4), 0.0]])
        parts += [opencv_matrix(f"M{side}", matrix), opencv_matrix(f"D{side}", terms)]
    moved = pair.right_from_left
    size = f"image_width: {pair.left.width}\nimage_height: {pair.left.height}"
    place = [opencv_matrix("R", moved.rotation), opencv_matrix("T", moved.translation_m[:, None])]
    head = "%YAML:1.0\n---\n"
    return head + "\n".join([size, *parts]) + "\n", head + "\n".join(place) + "\n"


def assert_near(one: StereoPair, other: StereoPair) -> None:
    for first, second in ((one.left, other.left), (one.right, other.right)):
        assert (first.fx, first.cx) == pytest.approx((second.fx, second.cx))
        terms = [(*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:4] for camera in (first, second)]
        assert terms[0] == pytest.approx(terms[1])
    moved, expected = one.right_from_left, other.right_from_left
    np.testing.assert_allclose(moved.rotation, expected.rotation, atol=1e-9)
    np.testing.assert_allclose(moved.translation_m, expected.translation_m)


def test_a_camchain_of_kalibr_is_read(tmp_path: Path) -> None:
    pair, path = bent_pair(), tmp_path / "camchain.yaml"
    path.write_text(kalibr(pair))
    assert_near(load_stereo(path), pair)


@pytest.mark.parametrize("in_one", [True, False])
def test_both_files_of_opencv_are_read(tmp_path: Path, in_one: bool) -> None:
    pair, path = bent_pair(), tmp_path / "intrinsics.yml"
    intrinsics, extrinsics = opencv(pair)
    if in_one:
        path.write_text(intrinsics + extrinsics.partition("---\n")[2])
    else:
        path.write_text(intrinsics)
        (tmp_path / "extrinsics.yml").write_text(extrinsics)
    assert_near(load_stereo(path), pair)


def test_the_rectified_pair_of_kitti_is_read(tmp_path: Path) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(
        "P0: 718.856 0 607.1928 0 0 718.856 185.2157 0 0 0 1 0\n"
        "P1: 718.856 0 607.1928 -386.1448 0 718.856 185.2157 0 0 0 1 0\n"
    )
    pair = load_stereo(path).scaled(1241, 376)
    assert pair.rectified.baseline_m == pytest.approx(386.1448 / 718.856)
    assert pair.left == PinholeCamera(1241, 376, 718.856, 718.856, 607.1928, 185.2157)


BROKEN = {
    "one camera": ('{"width": 4, "height": 4, "fx": 1}', "no known format of a stereo pair"),
    "no right": ('{"schema": "calib.stereo/1", "left": {}}', "right is None: expected a map"),
    "a text": ("hello", "no map of values"),
    "one matrix of KITTI": ("P0: " + "1 " * 12, "expected P2 and P3"),
    "a damaged number": ("P0: 7.1.8 " + "1 " * 11 + "\nP1: " + "1 " * 12, "P0 is '7.1.8'"),
    "a rotation vector": (
        opencv(bent_pair())[0] + "R: [0.0, 0.01, 0.0]\nT: [-0.12, 0.0, 0.0]\n",
        "R has 3 numbers: expected 3x3, as cv2.Rodrigues",
    ),
    "no place": (opencv(bent_pair())[0], "R or rotation or Rotation is missing"),
    "three cameras": (
        kalibr(bent_pair()) + "\n" + kalibr(bent_pair()).partition("cam1:")[0].replace("m0", "m2"),
        "it holds 3 cameras",
    ),
}


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_no_pair_is_refused_in_one_line(tmp_path: Path, name: str) -> None:
    text, words = BROKEN[name]
    (tmp_path / "pair.yaml").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        load_stereo(tmp_path / "pair.yaml")
    assert "pair.yaml" in str(caught.value)


def test_cameras_for_pictures_of_two_sizes_are_refused() -> None:
    small = CAMERA.scaled(CAMERA.width // 2, CAMERA.height // 2)
    place = RigidTransform(np.eye(3), np.array([-0.12, 0.0, 0.0]))
    with pytest.raises(CameraError, match="expected one size"):
        StereoPair(CAMERA, small, place)


def test_pictures_that_are_not_of_8_bits_are_refused() -> None:
    left, right = pictures(bent_pair())
    with pytest.raises(CameraError, match="the left picture is float64: expected uint8"):
        bent_pair().rectified.depth(left.astype(float), right)


def test_cameras_without_sizes_get_that_of_the_pictures() -> None:
    sizes = [(319.0, 242.0), (325.0, 236.0)]
    left, right = (sizeless_camera(525.0, 525.0, *centre, (), "radtan") for centre in sizes)
    place = RigidTransform(np.eye(3), np.array([-0.12, 0.0, 0.0]))
    pair = StereoPair(left, right, place).scaled(640, 480)
    assert (pair.left.width, pair.right.height) == (640, 480)
    assert pair.rectified.camera.fx == pytest.approx(525.0, rel=0.02)
