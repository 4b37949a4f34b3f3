"""What cannot be measured says why; nothing is ever NaN."""

import json
import math

import numpy as np
import pytest

from calib import PinholeCamera
from edgetree import InputError, TreeDetections
from edgetree.measure import Estimate, Failure, MeasureSettings, TreeMeasurement, measure_trees

UP = (0.0, -1.0, 0.0)


def changed(trees, keypoints=None, **options):
    values = {
        "boxes_px": trees.boxes_px,
        "scores": trees.scores,
        "keypoints_px": trees.keypoints_px if keypoints is None else keypoints,
        "masks": trees.masks,
        "image_width": trees.image_width,
        "image_height": trees.image_height,
    }
    return TreeDetections(**{**values, **options})


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 0.5, 4.0))


def measure(stand, trees=None, depth_m=None, up=True, **options):
    [tree] = measure_trees(
        stand.detections() if trees is None else trees,
        stand.depth_m if depth_m is None else depth_m,
        stand.camera,
        up_camera=stand.up if up else None,
        **options,
    )
    return tree


def all_fail(tree, reason):
    results = [getattr(tree, name) for name in TreeMeasurement.__dataclass_fields__]
    return all(isinstance(r, Failure) and not r and reason in r.reason for r in results)


def test_no_trees_give_no_measurements(stand):
    none = stand.detections().select(slice(0, 0))
    assert measure_trees(none, stand.depth_m, stand.camera) == []


def test_a_model_without_keypoints(stand):
    trees = stand.detections()
    bare = TreeDetections(trees.boxes_px, trees.scores, None, trees.masks, 1280, 720)
    assert all_fail(measure(stand, bare), "the model gives no keypoints")


@pytest.mark.parametrize("index", [1, 2])
def test_an_edge_outside_the_image(stand, index):
    keypoints = stand.detections().keypoints_px.copy()
    keypoints[0, index] = 0.0
    tree = measure(stand, changed(stand.detections(), keypoints))
    assert all_fail(tree, "the diameter keypoints are not in the image")


def test_edges_on_one_point(stand):
    keypoints = stand.detections().keypoints_px.copy()
    keypoints[0, 2] = keypoints[0, 1] + [0.25, 0.0, 0.0]
    tree = measure(stand, changed(stand.detections(), keypoints))
    assert all_fail(tree, "the diameter keypoints are 0.2 px apart")


def test_a_cut_outside_the_image_leaves_the_diameter(stand):
    keypoints = stand.detections().keypoints_px.copy()
    keypoints[0, 0] = 0.0
    tree = measure(stand, changed(stand.detections(), keypoints))
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.inclination_deg.value == pytest.approx(0.0, abs=0.3)
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert result == Failure("the felling cut is not in the image")


def test_axis_keypoints_outside_the_image_are_not_needed(stand):
    keypoints = stand.detections().keypoints_px.copy()
    keypoints[0, 3:] = 0.0
    tree = measure(stand, changed(stand.detections(), keypoints))
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.cut_height_m.value == pytest.approx(0.25, abs=0.01)


def test_no_depth_on_the_stem(stand):
    depth_m = np.where(stand.owner == 1, 0, stand.depth_m).astype(np.float32)
    assert all_fail(measure(stand, depth_m=depth_m), "no depth on the stem")


def test_a_stem_out_of_range(stand):
    tree = measure(stand, settings=MeasureSettings(max_range_m=3.0))
    assert all_fail(tree, "no depth on the stem")


def test_readings_that_are_not_finite_are_none(stand):
    depth_m = stand.depth_m.copy()
    depth_m[::3], depth_m[1::7], depth_m[2::11] = np.nan, np.inf, -1.0
    assert measure(stand, depth_m=depth_m).diameter_m.value == pytest.approx(0.3, rel=0.005)


def test_no_ground_around_the_base(stand):
    depth_m = np.where(stand.owner == 1, stand.depth_m, 0).astype(np.float32)
    tree = measure(stand, depth_m=depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.inclination_deg.value == pytest.approx(0.0, abs=0.3)
    assert not tree.cut_height_m
    assert tree.cut_height_m.reason.startswith("no ground around the base: ")
    tilted = measure(stand, depth_m=depth_m, up=False)
    assert tilted.inclination_deg.reason.startswith("no vertical: no ground around the base")


def test_a_thickness_that_no_stem_has(stand):
    tree = measure(stand, settings=MeasureSettings(max_diameter_m=0.25))
    assert all_fail(tree, "a diameter of 0.30 m is not plausible")


def test_too_few_pixels_for_a_diameter_still_give_a_distance(scene, pole):
    stand = scene(pole(0.05, 0.0, 8.0))
    tree = measure(stand, settings=MeasureSettings(keypoint_std_px=4.0, keypoint_spread=1e-6))
    assert tree.diameter_m.reason.startswith("the diameter is too uncertain: 0.05 m ± 0.07 m")
    assert tree.distance_m.value == pytest.approx(
        np.linalg.norm(stand.axis_point(stand.poles[0], 0.25)), rel=0.01
    )


def test_depth_of_another_size(stand):
    with pytest.raises(
        InputError, match=r"depth map has shape \(360, 640\): expected \(720, 1280\)"
    ):
        measure(stand, depth_m=stand.depth_m[::2, ::2])


def test_a_camera_for_another_size(stand):
    small = PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5)
    with pytest.raises(InputError, match="camera is for 640x360 px: expected 1280x720 px"):
        measure_trees(stand.detections(), stand.depth_m, small)


@pytest.mark.parametrize("up", [(0, 0, 0), (0, 1), (0, math.nan, 1)])
def test_a_vertical_that_is_no_direction(stand, up):
    with pytest.raises(InputError, match="expected a direction of three numbers"):
        measure_trees(stand.detections(), stand.depth_m, stand.camera, up_camera=up)


@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_settings_are_positive_numbers(value):
    with pytest.raises(InputError, match=r"keypoint_std_px is .*: expected a positive number"):
        MeasureSettings(keypoint_std_px=value)


def test_rubbish_gives_finite_numbers_or_reasons(stand):
    rng = np.random.default_rng(5)
    exact = stand.detections()
    numbers: list[float] = []
    for _ in range(100):
        blur_px = 10 ** rng.uniform(-1, 3.5)
        keypoints = exact.keypoints_px.copy()
        keypoints[..., :2] += rng.normal(0, blur_px, (1, 5, 2))
        keypoints[rng.random((1, 5)) < 0.05] = rng.choice([0.0, 1e9])
        boxes = exact.boxes_px + rng.normal(0, blur_px, (1, 4))
        masks = np.where(rng.random((1, 28, 28)) < 0.3, rng.random((1, 28, 28)), exact.masks)
        depth_m = stand.depth_m * np.float32(rng.choice([0.01, 1, 1, 1, 1000]))
        depth_m[:: rng.integers(1, 9), :: rng.integers(1, 5)] = rng.uniform(0, 30)
        up = None if rng.random() < 0.5 else stand.up + rng.normal(0, rng.choice([0.1, 2]), 3)
        trees = changed(exact, keypoints, boxes_px=boxes, masks=masks)
        for tree in measure_trees(trees, depth_m, stand.camera, up_camera=up):
            for name, value in tree.to_dict().items():
                if not name.endswith("_failure"):
                    numbers.extend(np.ravel(value).tolist())
    assert len(numbers) > 300
    assert np.isfinite(numbers).all()


def test_records_name_their_units():
    tree = TreeMeasurement(
        Estimate(0.31, 0.01), Failure("no ground"), Estimate(2.0, 0.5), Estimate(5.0, 0.02),
        np.array([1.0, 2.0, 3.0]),
    )  # fmt: skip
    expected = {
        "diameter_m": 0.31,
        "diameter_std_m": 0.01,
        "cut_height_failure": "no ground",
        "inclination_deg": 2.0,
        "inclination_std_deg": 0.5,
        "distance_m": 5.0,
        "distance_std_m": 0.02,
        "cut_point_m": [1.0, 2.0, 3.0],
    }
    assert json.loads(json.dumps(tree.to_dict())) == expected


def test_an_estimate_of_zero_is_still_true():
    assert Estimate(0.0, 0.0)


def moved(trees, index, dx_px, dy_px):
    keypoints = trees.keypoints_px.copy()
    keypoints[:, index, :2] += (dx_px, dy_px)
    return changed(trees, keypoints)


@pytest.mark.parametrize(
    ("dy_px", "reason"),
    [
        (-120, "m above the diameter's section"),
        (150, "m below the diameter's section"),
    ],
)
def test_a_cut_that_is_none_is_refused(stand, dy_px, reason):
    tree = measure(stand, moved(stand.detections(), 0, 0, dy_px))
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert isinstance(result, Failure)
        assert reason in result.reason
    assert tree.diameter_m


def test_a_cut_at_the_images_border_may_lie_beyond_it(stand):
    dy_px = 719.5 - stand.detections().keypoints_px[0, 0, 1]
    tree = measure(stand, moved(stand.detections(), 0, 0, dy_px))
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert isinstance(result, Failure)
        assert result.reason == "the felling cut is not in the image"
    assert tree.diameter_m


def test_a_cut_in_the_ground_is_refused(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0, cut_m=0.1, section_m=0.2))
    tree = measure(stand, moved(stand.detections(), 0, 0, 45))
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert isinstance(result, Failure)
        assert "m below the ground" in result.reason


@pytest.mark.parametrize("far_px", [1e5, 1e30])
def test_keypoints_absurdly_far_outside_count_as_missing(stand, far_px):
    assert all_fail(measure(stand, moved(stand.detections(), 1, -far_px, 0)), "diameter keypoints")
    assert measure(stand, moved(stand.detections(), 4, far_px, far_px)).diameter_m
