"""Properties of every camera: geometry there and back, and its files, for every lens model."""

import configparser
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, reject
from hypothesis import strategies as st

from basetree.errors import InputError
from calib import (
    CameraError,
    PinholeCamera,
    RigidTransform,
    depth_to_points,
    depth_to_range,
    load_camera,
    pixels_to_rays,
    project_points,
    range_to_depth,
    register_depth,
    save_camera,
)

SEEDS = st.integers(0, 2**32 - 1)
# Lenses as they are sold: (model, terms), each term varied by half its size.
LENSES: list[tuple[str, tuple[float, ...]]] = [
    ("radtan", ()),
    ("radtan", (-0.06, 0.01, 1e-3, -1e-3)),
    ("radtan", (-0.06, 0.01, -1e-3, 1e-3, 1e-3)),
    ("radtan", (0.6, 0.1, 1e-3, -1e-3, 0.01, 0.7, 0.15, 0.02)),
    ("radtan", (0.6, 0.1, 1e-3, -1e-3, 0.01, 0.7, 0.15, 0.02, 2e-3, -1e-3, -2e-3, 1e-3)),
    ("radtan", (-0.06, 0.01, 1e-3, -1e-3, 1e-3, *[0.0] * 7, 0.02, -0.03)),
    ("fisheye", (-0.03, 0.01, -0.004, 5e-4)),
]


@st.composite
def cameras(
    draw: st.DrawFn,
    lenses: list[tuple[str, tuple[float, ...]]] = LENSES,
    size: tuple[int, int] | None = None,
) -> PinholeCamera:
    """Cameras 37 to 84 degrees wide, of sides that 16 divides.

    All their pixels have a ray: no lens folds back before the corners of the image.
    """
    parts = draw(st.integers(40, 90))
    width, height = size or (16 * parts, 16 * round(parts * draw(st.floats(0.5, 0.75))))
    fx = width * draw(st.floats(0.55, 1.5))
    model, terms = draw(st.sampled_from(lenses))
    scatter = draw(st.lists(st.floats(0.5, 1.5), min_size=len(terms), max_size=len(terms)))
    values = (
        width,
        height,
        fx,
        fx * draw(st.floats(0.97, 1.03)),
        width * draw(st.floats(0.45, 0.55)),
        height * draw(st.floats(0.45, 0.55)),
        tuple(term * factor for term, factor in zip(terms, scatter, strict=True)),
        model,
        draw(st.floats(0, 3)),
    )
    try:  # some of these terms together fold back at the corners, or are no lens at all
        camera = PinholeCamera(*values)
        small(camera)
    except CameraError:
        reject()
    if not has_rays_everywhere(camera):
        reject()
    return camera


def has_rays_everywhere(camera: PinholeCamera) -> bool:
    corners_px = np.array([(x, y) for x in (0, camera.width) for y in (0, camera.height)], float)
    back_px = project_points(camera, pixels_to_rays(camera, corners_px))
    return bool(np.abs(back_px - corners_px).max() < 1e-6)


def small(camera: PinholeCamera) -> PinholeCamera:
    return camera.scaled(camera.width // 16, camera.height // 16)


def pixels_of(camera: PinholeCamera, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0, [camera.width, camera.height], (100, 2))


def depth_of(camera: PinholeCamera, seed: int) -> np.ndarray:
    """(H, W) float32 1 to 30 m, a fifth of it without a reading."""
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(1, 30, (camera.height, camera.width))
    depth_m[rng.random(depth_m.shape) < 0.2] = 0
    return depth_m.astype(np.float32)


@given(cameras(), SEEDS)
def test_projecting_a_pixels_ray_gives_the_pixel(camera: PinholeCamera, seed: int) -> None:
    xy_px = pixels_of(camera, seed)
    depths = np.random.default_rng(seed).uniform(0.3, 40, (len(xy_px), 1))
    points = pixels_to_rays(camera, xy_px) * depths
    np.testing.assert_allclose(project_points(camera, points), xy_px, atol=1e-6)


@given(cameras(), SEEDS)
def test_a_resized_image_keeps_its_rays(camera: PinholeCamera, seed: int) -> None:
    xy_px = pixels_of(camera, seed)
    half = camera.scaled(camera.width // 2, camera.height // 2)
    np.testing.assert_allclose(
        pixels_to_rays(half, xy_px / 2), pixels_to_rays(camera, xy_px), atol=1e-9
    )


@given(cameras(), SEEDS)
def test_a_part_of_the_image_keeps_its_rays(camera: PinholeCamera, seed: int) -> None:
    part = camera.cropped(64, 32, camera.width // 2, camera.height // 2)
    xy_px = pixels_of(part, seed)
    expected = pixels_to_rays(camera, xy_px + np.array([64, 32]))
    np.testing.assert_allclose(pixels_to_rays(part, xy_px), expected, atol=1e-9)
    first_cropped = part.scaled(part.width // 2, part.height // 2)
    first_scaled = camera.scaled(camera.width // 2, camera.height // 2).cropped(
        32, 16, part.width // 2, part.height // 2
    )
    np.testing.assert_allclose(numbers(first_cropped), numbers(first_scaled))


def numbers(camera: PinholeCamera) -> list[float]:
    return [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]


@given(cameras(), SEEDS)
def test_a_range_is_the_length_of_its_point_and_comes_back(
    camera: PinholeCamera, seed: int
) -> None:
    camera = small(camera)
    ranges = depth_of(camera, seed)
    depth_m = range_to_depth(ranges, camera)
    lengths = np.linalg.norm(depth_to_points(camera, depth_m), axis=-1)
    np.testing.assert_allclose(lengths, ranges, rtol=1e-6)
    np.testing.assert_allclose(depth_to_range(depth_m, camera), ranges, rtol=1e-6)


@given(cameras(), SEEDS)
def test_depth_registered_to_its_own_camera_stays(camera: PinholeCamera, seed: int) -> None:
    camera = small(camera)
    depth_m = depth_of(camera, seed)
    same = register_depth(depth_m, camera, camera, RigidTransform.identity())
    np.testing.assert_allclose(same, depth_m, rtol=1e-6)


@given(camera=cameras())
def test_a_camera_survives_its_file_to_the_last_bit(camera: PinholeCamera, tmp_path: Path) -> None:
    save_camera(tmp_path / "camera.json", camera)
    assert load_camera(tmp_path / "camera.json") == camera


@given(cameras())
def test_the_file_of_a_plain_camera_has_no_optional_fields(camera: PinholeCamera) -> None:
    plain = replace(camera, distortion=(), distortion_model="radtan", focal_std_px=0)
    names = ["width", "height", "fx", "fy", "cx", "cy", "distortion"]
    assert list(plain.to_dict()) == names


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner),
    max_leaves=6,
)


@given(camera=cameras(), data=st.data())
def test_a_file_with_a_wrong_field_is_read_or_refused_by_name(
    camera: PinholeCamera, data: st.DataObject, tmp_path: Path
) -> None:
    path = tmp_path / "camera.json"
    values = {"schema": "calib.camera/1", **camera.to_dict()}
    values[data.draw(st.sampled_from(sorted(values)))] = data.draw(JSON_VALUES)
    path.write_text(json.dumps(values))
    message = ""
    try:
        load_camera(path)
    except InputError as error:
        message = str(error)
    assert message.startswith(str(path) if message else "")
    assert "\n" not in message


# What other tools write: each writes a camera into a file by that tool's rules.


def matrix_of(camera: PinholeCamera) -> list[float]:
    return [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]


def size_of(camera: PinholeCamera) -> dict[str, int]:
    return {"image_width": camera.width, "image_height": camera.height}


def opencv_file(path: Path, camera: PinholeCamera) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in size_of(camera).items():
        storage.write(name, value)
    storage.write("fisheye_model", int(camera.distortion_model == "fisheye"))
    storage.write("camera_matrix", np.reshape(matrix_of(camera), (3, 3)))
    storage.write("distortion_coefficients", np.array([camera.distortion or [0.0] * 5]))
    storage.release()


def ros_camera_info(camera: PinholeCamera) -> dict[str, object]:
    fisheye, terms = camera.distortion_model == "fisheye", list(camera.distortion)
    model = "rational_polynomial" if len(terms) > 5 else "plumb_bob"
    return {
        **size_of(camera),
        "camera_name": "front",
        "camera_matrix": {"rows": 3, "cols": 3, "data": matrix_of(camera)},
        "distortion_model": "equidistant" if fisheye else model,
        "distortion_coefficients": {"rows": 1, "cols": len(terms), "data": terms},
    }


def ros_message(camera: PinholeCamera) -> object:
    info = ros_camera_info(camera)
    return {
        "header": {"frame_id": "front"},
        "width": camera.width,
        "height": camera.height,
        "distortion_model": info["distortion_model"],
        "d": list(camera.distortion),
        "k": matrix_of(camera),
    }


def orb_slam(camera: PinholeCamera) -> object:
    fisheye = camera.distortion_model == "fisheye"
    names = ("k1", "k2", "k3", "k4") if fisheye else ("k1", "k2", "p1", "p2", "k3")
    fields = dict(zip(("fx", "fy", "cx", "cy"), numbers(camera)[2:], strict=True))
    fields |= dict(zip(names, camera.distortion, strict=False))
    return {
        "Camera.type": "KannalaBrandt8" if fisheye else "PinHole",
        "Camera.width": camera.width,
        "Camera.height": camera.height,
        **{f"Camera1.{name}": value for name, value in fields.items()},
    }


def kalibr(camera: PinholeCamera) -> object:
    models = {"fisheye": "equidistant", "radtan": "radtan" if camera.distortion else "none"}
    return {
        "cam0": {
            "camera_model": "pinhole",
            "intrinsics": [camera.fx, camera.fy, camera.cx, camera.cy],
            "distortion_model": models[camera.distortion_model],
            "distortion_coeffs": list(camera.distortion),
            "resolution": [camera.width, camera.height],
        }
    }


def camodocal(camera: PinholeCamera) -> object:
    fisheye = camera.distortion_model == "fisheye"
    terms = ("k2", "k3", "k4", "k5") if fisheye else ("k1", "k2", "p1", "p2")
    focal = ("mu", "mv", "u0", "v0") if fisheye else ("fx", "fy", "cx", "cy")
    lens = dict(zip(terms, camera.distortion or [0.0] * 4, strict=True))
    values = dict(zip(focal, numbers(camera)[2:], strict=True))
    return {
        "model_type": "KANNALA_BRANDT" if fisheye else "PINHOLE",
        **size_of(camera),
        "distortion_parameters": {} if fisheye else lens,
        "projection_parameters": values | (lens if fisheye else {}),
    }


def realsense(camera: PinholeCamera) -> object:
    fisheye = camera.distortion_model == "fisheye"
    return {
        "width": camera.width,
        "height": camera.height,
        "fx": camera.fx,
        "fy": camera.fy,
        "ppx": camera.cx,
        "ppy": camera.cy,
        "model": "distortion.kannala_brandt4" if fisheye else "distortion.brown_conrady",
        "coeffs": [*camera.distortion, 0.0, 0.0, 0.0, 0.0, 0.0][:5],
    }


def ros_parameters(camera: PinholeCamera) -> object:
    lens = {"K": matrix_of(camera), "D": list(camera.distortion)}
    return {"/**": {"ros__parameters": {"cam": {**size_of(camera), camera.distortion_model: lens}}}}


def zed_file(path: Path, camera: PinholeCamera) -> None:
    fisheye = camera.distortion_model == "fisheye"
    names = ["k1", "k2", *(["k3", "k4"] if fisheye else ["p1", "p2", "k3", "k4", "k5", "k6"])]
    terms = camera.distortion or (0.0,) * 5
    parser = configparser.ConfigParser()
    focal = zip(("fx", "fy", "cx", "cy"), numbers(camera)[2:], strict=True)
    fields = [*focal, *zip(names, terms, strict=False)]
    parser["LEFT_CAM_HD"] = {name: repr(value) for name, value in fields}
    with path.open("w") as file:
        parser.write(file)


def as_text(values_of: Callable[[PinholeCamera], object]) -> Callable[[Path, PinholeCamera], None]:
    """A writer of YAML or JSON, as the path's suffix says."""

    def write(path: Path, camera: PinholeCamera) -> None:
        dump = json.dumps if path.suffix == ".json" else yaml.safe_dump
        path.write_text(dump(values_of(camera)))

    return write


WITH_FIVE = [lens for lens in LENSES if len(lens[1]) in (0, 5) or lens[0] == "fisheye"]
WITH_FOUR = [lens for lens in LENSES if len(lens[1]) in (0, 4)]
UP_TO_FIVE = [lens for lens in LENSES if len(lens[1]) <= 5]
OF_ZED = [lens for lens in LENSES if len(lens[1]) in (0, 5, 8) or lens[0] == "fisheye"]
HD = (1280, 720)
FORMATS: dict[str, tuple[str, Callable[[Path, PinholeCamera], None], st.SearchStrategy]] = {
    "own": ("camera.json", save_camera, cameras()),
    "OpenCV YAML": ("camera.yml", opencv_file, cameras()),
    "OpenCV XML": ("camera.xml", opencv_file, cameras()),
    "ROS camera_info": ("camera.yaml", as_text(ros_camera_info), cameras()),
    "ROS message": ("camera.yaml", as_text(ros_message), cameras()),
    "ORB-SLAM": ("settings.yaml", as_text(orb_slam), cameras(UP_TO_FIVE)),
    "Kalibr": ("camchain.yaml", as_text(kalibr), cameras(WITH_FOUR)),
    "CamOdoCal": ("camera.yaml", as_text(camodocal), cameras(WITH_FOUR)),
    "RealSense": ("camera.json", as_text(realsense), cameras(WITH_FIVE)),
    "ZED": ("SN1.conf", zed_file, cameras(OF_ZED, HD)),
    "ROS parameters": ("sensors.yaml", as_text(ros_parameters), cameras()),
}


@pytest.mark.parametrize("name", FORMATS)
@given(data=st.data())
def test_every_format_gives_back_the_camera_that_was_written(
    name: str, data: st.DataObject, tmp_path: Path
) -> None:
    file, write, known = FORMATS[name]
    camera = data.draw(known)
    if name != "own":  # no other format says how well the focal length is known
        camera = replace(camera, focal_std_px=0.0)
    write(tmp_path / file, camera)
    assert load_camera(tmp_path / file) == camera
