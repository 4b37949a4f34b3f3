"""Invalid depth, camera, masks, vertical and settings, and missing readings."""

import math
from dataclasses import replace

import numpy as np
import pytest

from calib import PinholeCamera, RigidTransform
from calib.sizeless import sizeless_camera
from edgetree import InputError
from edgetree.measure import MeasureSettings, TreeMeasurement, measure_trees


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 0.5, 4.0))


def test_depth_of_another_size(stand):
    with pytest.raises(
        InputError, match=r"depth map has shape \(360, 640\): expected \(720, 1280\), as the image"
    ):
        stand.measure(depth_m=stand.depth_m[::2, ::2])


@pytest.mark.parametrize("nothing", [None, [[1.0]]])
def test_depth_that_is_no_array(stand, nothing):
    with pytest.raises(InputError, match=r"the depth map is \w+: expected a plain numpy array"):
        measure_trees(stand.detections(), nothing, stand.camera)


@pytest.mark.parametrize("dtype", [np.uint16, np.int32])
def test_depth_in_millimetres(stand, dtype):
    with pytest.raises(InputError) as caught:
        stand.measure(depth_m=(1000 * stand.depth_m).astype(dtype))
    assert str(caught.value) == (
        f"the depth map holds {np.dtype(dtype)}: expected float metres (16-bit millimetres are"
        " read with calib.read_depth)"
    )


def test_floating_point_millimetres(stand):
    with pytest.raises(InputError, match=r"median of .* this looks like millimetres"):
        stand.measure(depth_m=1000 * stand.depth_m)


def test_a_camera_that_is_the_name_of_its_file(stand):
    with pytest.raises(
        InputError, match=r"camera is str: expected a PinholeCamera, as calib\.load"
    ):
        measure_trees(stand.detections(), stand.depth_m, "camera.json")


def test_a_measurement_prints_in_one_line(stand):
    tree = stand.measure()
    assert repr(tree).startswith(f"<TreeMeasurement: diameter {tree.diameter_m.value:.3f} ± ")
    failed = repr(TreeMeasurement.failed("no depth on the stem"))
    assert failed == "<TreeMeasurement: no diameter, no DBH, no distance>"


def test_depth_of_double_precision_is_depth(stand):
    single, double = (stand.measure(depth_m=stand.depth_m.astype(t)) for t in ("f4", "f8"))
    assert double.diameter_m == single.diameter_m


def test_a_camera_for_another_size(stand):
    small = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)
    with pytest.raises(InputError, match="camera is for 640x360 px: expected 1280x720 px"):
        measure_trees(stand.detections(), stand.depth_m, small)


@pytest.mark.parametrize("up", [(0, 0, 0), (0, 1), (0, math.nan, 1), "up"])
def test_a_vertical_that_is_no_direction(stand, up):
    with pytest.raises(InputError, match="expected a direction of three numbers"):
        measure_trees(stand.detections(), stand.depth_m, stand.camera, up_camera=up)


@pytest.mark.parametrize("name", ["keypoint_std_px", "max_range_m"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_settings_are_positive_numbers(name, value):
    with pytest.raises(InputError, match=f"{name} is .*: expected a positive number"):
        MeasureSettings(**{name: value})


@pytest.mark.parametrize("count", [0, 2])
def test_masks_for_another_number_of_trees(stand, count):
    with pytest.raises(InputError, match=rf"^there are {count} masks: expected 1, one per tree$"):
        stand.measure(masks=[stand.owner == 1] * count)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda mask: mask[:360], r"\(360, 1280\) of bool"),
        (lambda mask: mask.astype(np.uint8), r"\(720, 1280\) of uint8"),
        (lambda mask: mask[..., None], r"\(720, 1280, 1\) of bool"),
    ],
)
def test_masks_of_another_size_or_type(stand, change, found):
    message = rf"^a mask has shape {found}: expected \(720, 1280\) of bool$"
    with pytest.raises(InputError, match=message):
        stand.measure(masks=[change(stand.owner == 1)])


def test_masks_may_be_one_array(stand):
    mask = stand.owner == 1
    assert stand.measure(masks=mask[None]).diameter_m == stand.measure(masks=[mask]).diameter_m


def test_given_masks_replace_those_of_the_model(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0))
    trees = replace(stand.detections(), keypoints_px=None)
    empty = replace(trees, masks=np.zeros_like(trees.masks))
    assert not stand.measure(empty).diameter_m
    tree = stand.measure(empty, masks=[stand.owner == 1])
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.01)


def test_readings_that_are_not_finite_are_ignored(stand):
    depth_m = stand.depth_m.copy()
    depth_m[::3], depth_m[1::7], depth_m[2::11] = np.nan, np.inf, -1.0
    holes = np.where(np.isfinite(depth_m) & (depth_m > 0), depth_m, 0).astype(np.float32)
    for tree, same in (
        (stand.measure(depth_m=depth_m), stand.measure(depth_m=holes)),
        (stand.measure_mask(depth_m=depth_m), stand.measure_mask(depth_m=holes)),
    ):
        assert tree.diameter_m == same.diameter_m
        assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)


@pytest.mark.parametrize("rubbish", [0.0, np.nan, np.inf, -2.0])
def test_a_depth_map_without_any_reading(stand, rubbish):
    tree = stand.measure(depth_m=np.full_like(stand.depth_m, rubbish))
    assert tree.diameter_m.reason == "no depth on the stem"


def test_masked_depth_is_refused(stand):
    masked = np.ma.masked_less(stand.depth_m, 1.0)
    with pytest.raises(InputError, match="depth map is MaskedArray: expected a plain numpy"):
        measure_trees(stand.detections(), masked, stand.camera)


def test_a_camera_without_a_size_is_refused(stand):
    camera = sizeless_camera(698.4, 698.4, 639.5, 359.5, (), "radtan")
    with pytest.raises(InputError, match=r"expected camera\.scaled\(1280, 720\)"):
        measure_trees(stand.detections(), stand.depth_m, camera)


@pytest.mark.parametrize(
    ("mounting", "words"),
    [
        (
            RigidTransform.mounting([1500.0, 200.0, 2800.0]),
            "the mounting: the frames are",
        ),
        (RigidTransform.identity(), "by the mounting up is"),
        (np.eye(4), "the mounting is ndarray: expected a RigidTransform"),
    ],
)
def test_a_mounting_that_is_none(stand, mounting, words):
    with pytest.raises(InputError, match=words):
        measure_trees(stand.detections(), stand.depth_m, stand.camera, mounting=mounting)
