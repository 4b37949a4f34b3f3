"""What tells sizes in pictures without depth, and what the options' texts mean."""

from typing import Any

import numpy as np
import pytest

from basetree.errors import InputError
from calib import PinholeCamera
from edgetree.commands.option_groups import RigOptions
from edgetree.commands.reference_options import size_references, up_of_pitch
from edgetree.detections import TreeDetections
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import FoundTrees, measure_frame
from edgetree.frames.references import ScaleBar, SizeReferences
from edgetree.frames.rig import Rig
from edgetree.frames.turning import Turn, turn_of
from edgetree.measure import CameraHeight, ScaleMarks

CAMERA = PinholeCamera(640, 480, 500.0, 500.0, 319.5, 239.5)
PICTURE = np.full((480, 640, 3), 90, np.uint8)


def references(**given: str) -> Any:
    names = ("camera_height", "ground_slope", "horizon", "marker", "scale_bar")
    return size_references(*(given.get(name) for name in names))


def test_texts_give_height_slope_and_their_deviations() -> None:
    assert references() is None
    assert references(camera_height="2.4").camera_height == CameraHeight(2.4)
    whole = references(camera_height="2.4:0.05", ground_slope="8,-3:2")
    assert whole.camera_height == CameraHeight(2.4, 0.05, 8.0, -3.0, 2.0)
    bar = references(scale_bar="410,200,412,396,1.0").scale_bar
    assert bar == ScaleBar((410.0, 200.0, 412.0, 396.0), 1.0)


BAD = {
    "no number": ({"camera_height": "high"}, "--camera-height is 'high': expected metres"),
    "two heights": ({"camera_height": "2,3"}, "--camera-height is '2,3'"),
    "no height": ({"camera_height": "-1"}, "--camera-height -1: the camera's height is -1"),
    "slope alone": ({"ground_slope": "3"}, "--ground-slope given without --camera-height"),
    "three slopes": ({"camera_height": "2", "ground_slope": "1,2,3"}, "expected degrees such as"),
    "steep": ({"camera_height": "2", "ground_slope": "70"}, "expected degrees from -45 to 45"),
    "no bar": ({"scale_bar": "1,2,3,4"}, "--scale-bar is '1,2,3,4': expected two points"),
    "a point as bar": ({"scale_bar": "1,2,1,2,0.5"}, "--scale-bar is"),
    "no horizon": ({"horizon": "300"}, "--horizon is '300': expected two points"),
    "a point as horizon": (
        {"horizon": "300,10,300,10.5"},
        "a point on its left and one on its right",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_wrong_texts_are_named(case: str) -> None:
    given, words = BAD[case]
    with pytest.raises(InputError, match=words):
        references(**given)


@pytest.mark.parametrize("rotation_deg", [0, 90, 180, 270])
def test_a_pitch_and_a_horizon_give_the_same_vertical(rotation_deg: int) -> None:
    """Of a camera that is mounted upright, on its side or upside down."""
    back = turn_of(rotation_deg, None).back
    camera = back.camera(CAMERA)
    up = back.directions([0.0, -np.cos(np.radians(10.0)), -np.sin(np.radians(10.0))])
    row = 240.0 - 500.0 * np.tan(np.radians(10.0))
    ends = back.points([[0.0, row], [640.0, row]], CAMERA.width, CAMERA.height)
    references = SizeReferences(horizon_px=tuple(ends.ravel().tolist()))

    assert up_of_pitch(10.0, rotation_deg) == pytest.approx(up, abs=1e-9)
    rig = Rig(references=references, rotation_deg=rotation_deg)
    frame = Frame("a", None, np.zeros((camera.height, camera.width, 3), np.uint8))
    assert rig.vertical_of(frame, camera) == pytest.approx(up, abs=1e-6)


def test_a_horizon_that_goes_up_and_down_is_refused() -> None:
    references = SizeReferences(horizon_px=(300.0, 10.0, 300.0, 90.0))
    with pytest.raises(InputError, match="as seen in the upright picture"):
        references.up_camera(CAMERA, Turn())
    assert references.up_camera(CAMERA, Turn(1)) is not None


def test_one_vertical_and_one_way_to_distances_are_asked_for() -> None:
    with pytest.raises(InputError, match="--pitch given with --up: expected one of them"):
        RigOptions(up="0,-1,0", pitch=3.0).rig(None, None)
    with pytest.raises(InputError, match="--pitch is 80"):
        RigOptions(pitch=80.0).rig(None, None)
    with pytest.raises(InputError, match="--depth given with an option for pictures without"):
        RigOptions(camera_height="2").rig(None, "d.png")  # type: ignore[arg-type]


def test_exif_or_an_assumed_focal_length_make_a_camera() -> None:
    height, bar = CameraHeight(2.0), ScaleBar((1.0, 1.0, 1.0, 99.0), 1.0)
    stated = Frame("a", None, PICTURE, exif_focal_px=520.0)
    camera = SizeReferences(height).camera_for(stated, None)
    assert camera is not None
    assert (camera.fx, camera.focal_std_px) == (520.0, pytest.approx(0.04 * 520.0))
    unknown = Frame("a", None, PICTURE)
    assert SizeReferences(height).camera_for(unknown, None) is None
    guess = SizeReferences(scale_bar=bar).camera_for(unknown, None)
    assert guess is not None
    assert guess.focal_std_px > 0.2 * guess.fx
    assert SizeReferences(height).camera_for(stated, CAMERA) is CAMERA


def test_a_bar_follows_a_turned_picture_and_must_be_in_it() -> None:
    bar = SizeReferences(scale_bar=ScaleBar((10.0, 20.0, 10.0, 120.0), 1.0))
    [marks] = bar.ways(Frame("a", None, PICTURE), Turn(1))
    assert isinstance(marks, ScaleMarks)
    assert marks.marks[0].points_px == pytest.approx(np.array([[460.0, 10.0], [360.0, 10.0]]))
    outside = SizeReferences(scale_bar=ScaleBar((10.0, 20.0, 10.0, 999.0), 1.0))
    with pytest.raises(InputError, match="--scale-bar has an end outside of a"):
        outside.ways(Frame("a", None, PICTURE), Turn())


def test_a_picture_without_a_focal_length_says_what_is_missing() -> None:
    boxes = np.array([[300, 0, 340, 450]], np.float32)
    trees = TreeDetections(boxes, np.ones(1, np.float32), None, np.ones((1, 28, 28)), 640, 480)
    rig = Rig(references=SizeReferences(CameraHeight(2.0)), up_camera=(0.0, -1.0, 0.0))
    frame = Frame("a", None, PICTURE)
    result = measure_frame(frame, FoundTrees.detected(trees), rig)
    assert "pass --camera; the picture's EXIF states no focal length" in str(result.metres_need)
    assert result.pixel_sizes[0].width_px.value == pytest.approx(40, abs=2)
    known = Frame("a", None, PICTURE, exif_focal_px=500.0)
    [tree] = measure_frame(known, FoundTrees.detected(trees), rig).measurements or []
    # The foot is 210 px below the horizon, by a focal length of 500 px.
    assert tree.axis_distance_m.value == pytest.approx(2.0 * 500 / 210 * 1.04, rel=0.03)
