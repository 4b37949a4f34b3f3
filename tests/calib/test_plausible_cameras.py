"""Cameras that no lens can have are refused, unusual ones are named."""

import logging
import math
import time
from dataclasses import replace
from pathlib import Path

import pytest

from calib import CameraError, PinholeCamera, load_camera, save_camera

CAMERA = PinholeCamera(1280, 720, 900.0, 901.0, 641.5, 355.0, (-0.1, 0.02, 1e-3, -2e-3, 5e-3))
WIDE = PinholeCamera(640, 480, 180.0, 180.0, 320.0, 240.0, (0.01, 0.0, 0.0, 0.0), "fisheye")

IMPOSSIBLE = [
    # normalised focal lengths, millimetres, and others
    ({"fx": 1.0, "fy": 1.0, "cx": 0.5, "cy": 0.5}, "a field of view of 180 degrees: expected 0.1"),
    ({"fx": 20.0, "fy": 20.0}, "with fx and fy in pixels"),
    ({"fx": 4.0, "fy": 4.0, "distortion": ()}, "a field of view of 179 degrees"),
    ({"fx": 1e300, "fy": 1e300}, "a field of view of 7.33e-296 degrees"),
    ({"fx": 1e300}, "fx is 1e+300 and fy 901: expected nearly the same"),
    ({"fy": 100.0}, "a ratio of at most 4"),
    ({"fx": 5e-324}, "field of view"),
    # the size of the image
    ({"width": 10**300}, "expected at most 100000 px on each side"),
    ({"height": 200_000}, "1280x200000: expected at most 100000 px"),
    # the principal point
    ({"cx": 2000.0}, "cx is 2000.0: expected a point near the image, 1280 px: from -640 to 1920"),
    ({"cy": -400.0}, "cy is -400.0: expected a point near the image"),
    ({"cx": 1e300}, "cx is 1e+300: expected a point near"),
    # lenses
    ({"distortion": (-1.0, 0.0, 0.0, 0.0)}, "% of the image: expected a radtan lens that does not"),
    ({"distortion": (1e300, 0.0, 0.0, 0.0)}, "gives one ray for only 0 % of the image"),
    ({"distortion": (1e6, 0.0, 0.0, 0.0)}, "of the image: expected"),
    ({"distortion": (300.0, 0.0, 0.0, 0.0)}, "times closer to the centre"),
    ({"distortion": (0.0, 0.0, 0.5, 0.5)}, "fold it over"),
    ({"distortion": (0.0, 0.0, 0.0, 0.0, 0.0, 1e200, 1e200, 1e200)}, "of the image"),
    (
        {"distortion": (-5.0, 0.0, 0.0, 0.0), "distortion_model": "fisheye"},
        "expected a fisheye lens that does not fold it over, at least 25 %",
    ),
    # how well the focal length is known
    ({"focal_std_px": 1e300}, "less than fx and fy"),
    ({"focal_std_px": math.nan}, "focal_std_px is nan: expected 0 or more"),
]


@pytest.mark.parametrize(("change", "message"), IMPOSSIBLE)
def test_impossible_cameras_are_refused_in_code(change: dict[str, object], message: str) -> None:
    with pytest.raises(CameraError) as caught:
        replace(CAMERA, **change)
    assert message in str(caught.value)


def test_impossible_cameras_in_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text("width: 1280\nheight: 720\nfx: 0.7\nfy: 0.7\ncx: 0.5\ncy: 0.5\n")
    with pytest.raises(CameraError, match=r"camera\.yaml: fx is 0\.7 and fy 0\.7 for 1280x720 px"):
        load_camera(path)


USUAL = [
    CAMERA,
    WIDE,
    # a lens of 180 degrees whose circle fills the height, and its black corners
    PinholeCamera(1920, 1080, 340.0, 340.0, 960.0, 540.0, (-0.02, 0.003, -0.001, 0.0), "fisheye"),
    # an action camera, a phone, a telephoto lens, a rational lens
    PinholeCamera(1920, 1080, 870.0, 870.0, 960.0, 540.0, (-0.25, 0.08, 0.0, 0.0, -0.01)),
    PinholeCamera(4032, 3024, 3000.0, 3000.0, 2010.0, 1500.0, (0.2, -0.5, 0.0, 0.0, 0.45)),
    PinholeCamera(1280, 720, 12000.0, 12000.0, 630.0, 350.0),
    replace(CAMERA, distortion=(0.6, 0.1, 1e-3, -1e-3, 0.01, 0.7, 0.15, 0.02)),
]


@pytest.mark.parametrize("camera", USUAL)
def test_usual_cameras_are_read_without_a_word(
    camera: PinholeCamera, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    save_camera(tmp_path / "camera.json", camera)
    with caplog.at_level(logging.WARNING):
        assert load_camera(tmp_path / "camera.json") == camera
    assert not caplog.messages
    assert not camera.unusual_values()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": 230.0, "fy": 230.0, "distortion": ()}, "the field of view is 140 degrees, usual"),
        ({"fx": 30_000.0, "fy": 30_000.0}, "the field of view is 2.44 degrees"),
        ({"fy": 700.0}, "fx is 900 and fy 700, usual are nearly equal values"),
        ({"cx": 100.0}, "cx is 100, usual are values near 640"),
        ({"distortion": (-0.42, 0.0, 0.0, 0.0)}, "% of the image over, where nothing can be"),
    ],
)
def test_unusual_cameras_are_read_with_a_warning(
    change: dict[str, object], message: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "camera.json"
    save_camera(path, replace(CAMERA, **change))
    with caplog.at_level(logging.WARNING):
        load_camera(path)
    (line,) = caplog.messages
    assert line.startswith(f"{path}: ")
    assert message in line


def test_every_part_of_an_image_has_a_camera() -> None:
    corner = CAMERA.cropped(1240, 700, 40, 20)
    assert (corner.cx, corner.cy) == (641.5 - 1240, 355.0 - 700)
    assert corner.scaled(80, 40).width == 80
    with pytest.raises(CameraError, match="at most 100000 px"):
        CAMERA.scaled(1280_000, 720_000)


def test_a_camera_for_every_frame_costs_little() -> None:
    replace(CAMERA)
    started = time.process_time()
    for _ in range(300):
        replace(CAMERA)
    assert (time.process_time() - started) / 300 < 2e-4
