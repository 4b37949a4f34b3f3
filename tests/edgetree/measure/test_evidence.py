"""Evidence and warnings of a measurement."""

from dataclasses import replace

import numpy as np
import pytest

from calib import project_points
from edgetree.measure import MeasureSettings


@pytest.fixture(scope="module")
def stand(scene, pole):
    return scene(pole(0.3, 0.5, 4.0))


def test_the_method_names_the_sources_used(stand):
    trees = stand.detections()
    assert stand.measure(trees, settings=None).evidence.method == "keypoints + mask + depth"
    bare = stand.measure(replace(trees, masks=None), settings=None).evidence
    assert bare.method == "keypoints + depth"
    assert set(bare.source_diameters_m) == {"keypoints", "depth"}
    masked = stand.measure_mask(settings=None).evidence
    assert masked.method == "mask + depth"
    assert set(masked.source_std_m) == {"mask", "depth"}


def test_every_source_gives_its_own_diameter(stand):
    evidence = stand.measure(masks=stand.masks(), settings=None).evidence
    for source, diameter_m in evidence.source_diameters_m.items():
        assert diameter_m == pytest.approx(0.3, abs=evidence.source_std_m[source])
    assert evidence.source_diameters_m["keypoints"] == pytest.approx(0.3, rel=0.005)


@pytest.mark.parametrize("off_px", [-4.0, 4.0])
def test_the_curvature_of_the_depth_gives_a_diameter_by_itself(stand, off_px):
    trees = replace(stand.detections(), masks=None)
    keypoints = trees.keypoints_px.copy()
    keypoints[0, 1, 0] -= off_px
    keypoints[0, 2, 0] += off_px
    evidence = stand.measure(replace(trees, keypoints_px=keypoints), settings=None).evidence
    errors_m = {name: abs(d - 0.3) for name, d in evidence.source_diameters_m.items()}
    assert errors_m["keypoints"] > 0.035
    assert errors_m["depth"] < 0.5 * errors_m["keypoints"]


def test_disagreeing_sources_increase_the_standard_deviation(stand):
    trees = stand.detections()
    keypoints = trees.keypoints_px.copy()
    keypoints[0, 1, 0] -= 30
    torn = stand.measure(replace(trees, keypoints_px=keypoints), settings=None)
    [warning] = torn.evidence.warnings
    assert warning == (
        f"keypoints and mask disagree: {100 * torn.evidence.source_diameters_m['keypoints']:.1f} cm"
        f" and {100 * torn.evidence.source_diameters_m['mask']:.1f} cm"
    )
    agreed = stand.measure(trees, settings=None)
    assert agreed.evidence.warnings == ()
    assert torn.diameter_m.std > 1.5 * agreed.diameter_m.std


def test_the_arc_is_the_part_of_the_circumference_with_depth(stand):
    whole = stand.measure().evidence.arc_deg
    assert 90 < whole < 180
    columns = np.arange(stand.camera.width)[None]
    middle = project_points(stand.camera, stand.axis_point(stand.poles[0], 1.0))[0]
    left_only = np.where((stand.owner == 1) & (columns > middle), 0, stand.depth_m)
    half = stand.measure(depth_m=left_only.astype(np.float32)).evidence
    assert half.arc_deg == pytest.approx(whole / 2, rel=0.2)


@pytest.mark.parametrize("share", [0.25, 0.6, 1.0])
def test_valid_depth_share_counts_holes_in_the_depth(stand, share):
    kept = np.random.default_rng(1).random(stand.depth_m.shape) < share
    depth_m = np.where(kept, stand.depth_m, 0).astype(np.float32)
    tree = stand.measure(depth_m=depth_m)
    assert tree.evidence.valid_depth_share == pytest.approx(share, abs=0.08)
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.01)


@pytest.mark.parametrize("hidden", [0.0, 0.3, 0.5])
def test_visible_share_counts_hidden_parts(stand, hidden):
    mask = stand.owner == 1
    rows = np.flatnonzero(mask.any(1))
    low, high = (int(np.quantile(rows, 0.4 + sign * hidden / 2)) for sign in (-1, 1))
    mask[low:high] = False
    tree = stand.measure(masks=[mask])
    assert tree.evidence.visible_share == pytest.approx(1 - hidden, abs=0.06)


def test_the_ground_is_described(stand):
    words = stand.measure().evidence.ground
    assert words.startswith("plane within 1.4 m of the stem, ")
    assert words.endswith("heights along the given vertical")
    assert stand.measure(level=True).evidence.ground.endswith(
        "heights along a vertical estimated from the ground's slope and the camera's own up (± 9°)"
    )
    floating = np.where(stand.owner == 1, stand.depth_m, 0).astype(np.float32)
    assert stand.measure(depth_m=floating).evidence.ground.startswith("no ground around the base")


@pytest.mark.parametrize(("cut_m", "warned"), [(0.27, False), (0.34, True)])
def test_a_high_stump_gives_a_warning(scene, pole, cut_m, warned):
    stand = scene(pole(0.3, 0.5, 4.0, cut_m=cut_m, section_m=0.5))
    tree = stand.measure()
    std_m = tree.cut_height_m.std
    expected = f"the stump would be {100 * cut_m:.0f} ± {100 * std_m:.0f} cm high, limit 30 cm"
    assert tree.evidence.warnings == ((expected,) if warned else ())
    assert stand.measure(settings=MeasureSettings(max_stump_height_m=0.5)).evidence.warnings == ()


def test_a_stump_within_the_error_of_the_limit_gives_no_warning(scene, pole):
    stand = scene(pole(0.3, 0.5, 4.0, cut_m=0.31, section_m=0.5))
    tree = stand.measure(settings=None)
    assert tree.cut_height_m.value > 0.3
    assert tree.cut_height_m.value - tree.cut_height_m.std < 0.3
    assert tree.evidence.warnings == ()


def test_without_a_mask_there_is_no_visible_share(stand):
    trees = stand.detections()
    bare = type(trees)(trees.boxes_px, trees.scores, trees.keypoints_px, None, 1280, 720)
    tree = stand.measure(bare)
    assert tree.diameter_m
    assert tree.evidence.visible_share is None


def test_a_part_of_a_stem_alone_is_measured_as_it_is(scene, pole):
    """Without a foot and ground, as a phone sees a stem at breast height, no stump is inferred."""
    stand = scene(pole(0.3, 0.0, 2.0), pitch_deg=-20.0)
    tree = stand.measure(settings=None)
    assert tree.evidence.warnings == (
        "the cut is not in the picture: the diameter is that of the part that is seen",
    )
    assert tree.diameter_m.value == pytest.approx(0.3, rel=0.02)


def test_a_cut_below_the_image_is_inferred_with_a_warning(scene, pole):
    stand = scene(pole(0.3, 0.0, 2.5, top_m=6.0), camera_height_m=1.8, pitch_deg=0.0)
    assert stand.detections().keypoints_px[0, :3, 1].min() > stand.camera.height
    tree = stand.measure(settings=None)
    assert tree.evidence.warnings == (
        "the cut is not in the picture: its diameter is inferred from the stem above",
    )
    shown = stand.measure_mask(settings=None)
    assert shown.evidence.warnings == ()
    assert shown.diameter_m.value == pytest.approx(0.3, rel=0.01)
    # Stems are thicker at the butt than above it. A cylinder is not, so the result is too large.
    assert 1.05 < tree.diameter_m.value / shown.diameter_m.value < 1.25
    assert tree.diameter_m.std > 1.5 * shown.diameter_m.std
    low_m, high_m = tree.diameter_m.interval95
    assert low_m < 0.3 < high_m
    assert not tree.cut_height_m
