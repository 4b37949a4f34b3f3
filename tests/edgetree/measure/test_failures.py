"""Failed measurements give a reason, and no value is NaN."""

from dataclasses import replace

import numpy as np
import pytest

from edgetree import TreeDetections
from edgetree.measure import Failure, MeasureSettings, TreeMeasurement, measure_trees

NO_EDGES = "neither the diameter keypoints nor the mask show both edges of the stem"


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 0.5, 4.0))


def all_fail(tree, reason):
    names = [
        name
        for name in TreeMeasurement.__dataclass_fields__
        if name not in ("evidence", "rig_std", "species")
    ]
    results = [getattr(tree, name) for name in names]
    return all(isinstance(r, Failure) and not r and reason in r.reason for r in results)


def with_keypoints(trees, index, values):
    keypoints = trees.keypoints_px.copy()
    keypoints[0, index] = values
    return replace(trees, keypoints_px=keypoints)


def moved(trees, index, dx_px, dy_px):
    keypoints = trees.keypoints_px.copy()
    keypoints[:, index, :2] += (dx_px, dy_px)
    return replace(trees, keypoints_px=keypoints)


def test_no_trees_give_no_measurements(stand):
    none = stand.detections().select(slice(0, 0))
    assert measure_trees(none, stand.depth_m, stand.camera) == []


def test_a_model_with_neither_keypoints_nor_masks(stand):
    bare = replace(stand.detections(), keypoints_px=None, masks=None)
    assert all_fail(stand.measure(bare), "the model gives neither keypoints nor masks")


@pytest.mark.parametrize("index", [1, 2])
def test_without_one_edge_keypoint_the_mask_is_used(stand, index):
    trees = with_keypoints(stand.detections(), index, 0.0)
    tree = stand.measure(trees)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.01)
    assert "keypoints" not in tree.evidence.method
    bare = replace(trees, masks=None)
    assert all_fail(stand.measure(bare), "the diameter keypoints are not in the image")


@pytest.mark.parametrize(("index", "x_px"), [(1, 0.05), (2, 1279.95)])
def test_an_edge_keypoint_at_the_image_border_is_not_used(stand, index, x_px):
    trees = stand.detections()
    trees = with_keypoints(trees, index, [x_px, trees.keypoints_px[0, index, 1], 1.0])
    tree = stand.measure(trees)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.01)
    assert "keypoints" not in tree.evidence.method


def test_coinciding_edge_keypoints_are_not_used(stand):
    trees = stand.detections()
    trees = with_keypoints(trees, 2, trees.keypoints_px[0, 1] + [0.25, 0.0, 0.0])
    assert stand.measure(trees).diameter_m.value == pytest.approx(0.3, rel=0.01)
    assert not stand.measure(replace(trees, masks=None)).diameter_m


def test_a_cut_outside_the_image_leaves_the_diameter(stand):
    tree = stand.measure(with_keypoints(stand.detections(), 0, 0.0))
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.inclination_deg.value == pytest.approx(0.0, abs=0.3)
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m, tree.cut_point_machine_m):
        assert result == Failure("the felling cut is not in the image")


def test_axis_keypoints_outside_the_image_are_not_needed(stand):
    tree = stand.measure(with_keypoints(stand.detections(), slice(3, 5), 0.0))
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.cut_height_m.value == pytest.approx(0.25, abs=0.01)


def test_no_depth_on_the_stem(stand):
    depth_m = np.where(stand.owner == 1, 0, stand.depth_m).astype(np.float32)
    assert all_fail(stand.measure(depth_m=depth_m), "no depth on the stem")
    assert all_fail(stand.measure_mask(depth_m=depth_m), "no depth on the stem")


def test_an_empty_depth_map(stand):
    assert all_fail(stand.measure(depth_m=np.zeros_like(stand.depth_m)), "no depth on the stem")


def test_a_stem_out_of_range(stand):
    tree = stand.measure(settings=MeasureSettings(max_range_m=3.0))
    assert all_fail(tree, "no depth on the stem")


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("shows", ["nothing", "a pixel"])
def test_a_mask_that_hardly_shows_anything(stand, shows, given):
    mask = np.zeros(stand.owner.shape if given else (28, 28), bool)
    if shows == "a pixel":
        mask[mask.shape[0] // 2, mask.shape[1] // 2] = True
    trees = replace(stand.detections(), keypoints_px=None)
    if given:
        tree = stand.measure(trees, masks=[mask])
    else:
        tree = stand.measure(replace(trees, masks=mask[None].astype(np.float32)))
    assert all_fail(tree, tree.diameter_m.reason)
    assert tree.diameter_m.reason in (NO_EDGES, "the mask shows hardly any of the stem")


def test_a_tree_that_fails_does_not_change_the_others(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0), pole(0.4, -1.0, 5.0), pole(0.2, 2.0, 4.5))
    trees, masks = stand.detections(), stand.masks()
    masks[1] = np.zeros_like(masks[1])
    keypoints = trees.keypoints_px.copy()
    keypoints[1] = 0.0
    trees = replace(trees, keypoints_px=keypoints)
    first, empty, last = measure_trees(
        trees, stand.depth_m, stand.camera, masks=masks, up_camera=stand.up
    )
    assert all_fail(empty, NO_EDGES)
    for index, tree in ((0, first), (2, last)):
        alone = trees.select(slice(index, index + 1))
        assert tree.diameter_m.value == pytest.approx(
            stand.measure(alone, masks=masks[index : index + 1], settings=None).diameter_m.value,
            rel=1e-4,
        )


def test_no_ground_around_the_base(stand):
    depth_m = np.where(stand.owner == 1, stand.depth_m, 0).astype(np.float32)
    tree = stand.measure(depth_m=depth_m)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.005)
    assert tree.inclination_deg.value == pytest.approx(0.0, abs=0.3)
    for result in (tree.cut_height_m, tree.dbh_m):
        assert result.reason.startswith("no ground around the base: ")
    tilted = stand.measure(depth_m=depth_m, level=True)
    for result in (tilted.inclination_deg, tilted.lean_direction_deg):
        assert result.reason.startswith("no vertical: no ground around the base")


def test_an_implausible_diameter_is_a_failure(stand):
    tree = stand.measure(settings=MeasureSettings(max_diameter_m=0.25))
    assert all_fail(tree, "a diameter of 30.0 cm is not plausible")


def test_too_few_pixels_for_a_diameter_still_give_a_distance(scene, pole, exact):
    stand = scene(pole(0.05, 0.0, 8.0))
    bare = replace(stand.detections(), masks=None)
    tree = stand.measure(bare, settings=replace(exact, keypoint_std_px=4.0))
    assert tree.diameter_m.reason == "the diameter is too uncertain: 5.0 ± 6.6 cm"
    assert tree.distance_m.value == pytest.approx(
        np.linalg.norm(stand.axis_point(stand.poles[0], 0.25)), rel=0.01
    )


@pytest.mark.parametrize(
    ("dy_px", "reason"),
    [
        (-120, "m above the diameter's section"),
        (150, "m below the diameter's section"),
    ],
)
def test_an_implausible_cut_is_a_failure(stand, dy_px, reason):
    tree = stand.measure(moved(stand.detections(), 0, 0, dy_px))
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert isinstance(result, Failure)
        assert reason in result.reason
    assert tree.diameter_m


def test_a_cut_at_the_image_border_is_a_failure(stand):
    dy_px = 719.95 - stand.detections().keypoints_px[0, 0, 1]
    tree = stand.measure(moved(stand.detections(), 0, 0, dy_px))
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert isinstance(result, Failure)
        assert result.reason == "the felling cut is not in the image"
    assert tree.diameter_m


@pytest.mark.parametrize("above_px", [12, 60])
def test_a_doubtful_cut_above_the_lower_border_is_named_as_such(scene, pole, above_px):
    """Networks put the cut of a stem that leaves the picture just above the border."""
    stand = scene(pole(0.3, 0.0, 2.0), pitch_deg=-20.0)
    trees = with_keypoints(stand.detections(), 0, [640.0, 720.0 - above_px, 0.1])
    tree = stand.measure(trees, settings=None)
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert result.reason.startswith("the felling cut may be below the image")
        assert f"only {above_px} px above it" in result.reason
    assert tree.diameter_m


def test_a_cut_below_the_ground_is_a_failure(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0, cut_m=0.1, section_m=0.2))
    tree = stand.measure(moved(stand.detections(), 0, 0, 45))
    for result in (tree.cut_height_m, tree.distance_m, tree.cut_point_m):
        assert isinstance(result, Failure)
        assert "cm below the ground" in result.reason


@pytest.mark.parametrize("far_px", [1e5, 1e30])
def test_keypoints_far_outside_the_image_are_ignored(stand, far_px):
    trees = moved(stand.detections(), 1, -far_px, 0)
    assert "keypoints" not in stand.measure(trees).evidence.method
    assert all_fail(stand.measure(replace(trees, masks=None)), "diameter keypoints")
    assert stand.measure(moved(stand.detections(), 4, far_px, far_px)).diameter_m


def numbers_of(values):
    """All numbers in a record."""
    for value in values:
        if isinstance(value, dict):
            yield from numbers_of(value.values())
        elif isinstance(value, (list, tuple)):
            yield from numbers_of(value)
        elif value is not None and not isinstance(value, str):
            yield float(value)


def test_one_impossible_tree_does_not_spoil_the_others(stand):
    good = stand.detections()
    width, height = good.image_width, good.image_height
    boxes = np.concatenate([good.boxes_px, [[639, 254, 639, 612]]])
    trees = TreeDetections(boxes, np.ones(2), None, None, width, height)
    everything = np.ones((height, width), np.bool_)
    first, second = measure_trees(
        trees, stand.depth_m, stand.camera, masks=[stand.owner == 1, everything], up_camera=stand.up
    )
    assert first.diameter_m.value == pytest.approx(0.3, rel=0.02)
    assert not second.diameter_m


@pytest.mark.filterwarnings("error")
def test_random_input_gives_finite_numbers_or_reasons(stand):
    rng = np.random.default_rng(5)
    exact = stand.detections()
    numbers: list[float] = []
    for round_ in range(100):
        blur_px = 10 ** rng.uniform(-1, 3.5)
        keypoints = exact.keypoints_px.copy()
        keypoints[..., :2] += rng.normal(0, blur_px, (1, 5, 2))
        keypoints[rng.random((1, 5)) < 0.05] = rng.choice([0.0, 1e9])
        boxes = exact.boxes_px + rng.normal(0, blur_px, (1, 4))
        masks = np.where(rng.random((1, 28, 28)) < 0.3, rng.random((1, 28, 28)), exact.masks)
        depth_m = stand.depth_m * np.float32(rng.choice([0.01, 1, 1, 1, 100]))
        depth_m[:: rng.integers(1, 9), :: rng.integers(1, 5)] = rng.uniform(0, 30)
        up = None if rng.random() < 0.5 else stand.up + rng.normal(0, rng.choice([0.1, 0.2]), 3)
        trees = replace(
            exact,
            keypoints_px=None if round_ % 4 == 3 else keypoints,
            boxes_px=boxes,
            masks=None if round_ % 4 == 2 else masks,
        )
        for tree in measure_trees(trees, depth_m, stand.camera, up_camera=up):
            numbers.extend(numbers_of([tree.to_dict()]))
    assert len(numbers) > 600
    assert np.isfinite(numbers).all()


@pytest.mark.parametrize("ahead_m", [1.2, 2.5])
def test_the_stems_own_depth_is_not_ground(scene, pole, ahead_m):
    """A time-of-flight capture that shows the stem alone, cut off by the picture's lower edge."""
    stand = scene(pole(0.3, 0.1, ahead_m, top_m=4.0), pitch_deg=-20.0, camera_height_m=1.5)
    stem = stand.owner == 1
    assert stem[-1].any()
    tree = stand.measure_mask(depth_m=np.where(stem, stand.depth_m, 0.0), level=True)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.02)
    assert "no ground around the base" in tree.evidence.ground
    assert "no vertical" in tree.inclination_deg.reason
