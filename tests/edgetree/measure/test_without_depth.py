"""Stems without depth: by the camera's height, marks of known length, and the camera's motion."""

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from basetree.errors import InputError
from calib import PinholeCamera, RigidTransform, project_points
from edgetree.measure import (
    EXACT_RIG,
    CameraHeight,
    MeasureSettings,
    RigUncertainty,
    ScaleMark,
    ScaleMarks,
    StemViews,
    TreeMeasurement,
    Way,
    measure_without_depth,
)
from edgetree.measure.constants.placing import POSE_SCALE_STD, POSE_TURN_STD_DEG

EXACT_HEIGHT = CameraHeight(1.8, height_std_m=0.0, slope_std_deg=0.0)


@pytest.fixture
def measured(exact: MeasureSettings) -> Callable[..., TreeMeasurement]:
    """Measure the first stem of a scene by a way or several."""

    def measure(scene: Any, *ways: Way, **options: Any) -> TreeMeasurement:
        options = {"up_camera": scene.up, "rig_uncertainty": EXACT_RIG, "settings": exact} | options
        trees = options.pop("trees", None) or scene.detections()
        return measure_without_depth(trees, scene.camera, ways, **options)[0]

    return measure


@pytest.fixture(scope="module")
def stand(scene: Any, pole: Any) -> Any:
    """One stem, 5 m away."""
    return scene(pole(right_m=0.6, taper=0.01))


@pytest.mark.parametrize("slope_deg", [0.0, 9.0, -6.0])
def test_the_cameras_height_tells_distance_and_diameters(
    scene: Any, pole: Any, measured: Any, slope_deg: float
) -> None:
    stem = pole(right_m=0.6, taper=0.01)
    stand = scene(stem, slope_deg=slope_deg)
    tree = measured(stand, replace(EXACT_HEIGHT, ahead_deg=slope_deg))
    centre = stand.axis_point(stem, stem.cut_m)
    assert tree.distance_m.value == pytest.approx(np.linalg.norm(centre), rel=0.01)
    assert tree.diameter_m.value == pytest.approx(stem.diameter_at_m(stem.section_m), rel=0.02)
    assert tree.dbh_m.value == pytest.approx(stem.diameter_at_m(1.3), rel=0.02)
    assert tree.cut_height_m.value == pytest.approx(stand.cut_height_m(stem), abs=0.03)
    assert tree.evidence.distance_from.startswith("the camera's height above")


def test_only_the_lean_across_the_view_is_seen(stand: Any, measured: Any) -> None:
    tree = measured(stand, EXACT_HEIGHT)
    assert "towards or away from the camera is not seen" in tree.inclination_deg.reason
    assert not tree.lean_direction_deg


WIDENED = {
    "height": ({"height_std_m": 0.18}, {}, "the camera's height (--camera-height)"),
    "slope": ({"slope_std_deg": 4.0}, {}, "the slope of the ground (--ground-slope)"),
    "vertical": ({}, {"vertical_std_deg": 4.0}, "the vertical (--up)"),
    "principal point": ({}, {"principal_std_px": 30.0}, "the principal point (--camera)"),
}


@pytest.mark.parametrize("term", WIDENED)
def test_each_error_widens_the_distance_and_is_named(stand: Any, measured: Any, term: str) -> None:
    of_way, of_rig, words = WIDENED[term]
    sure = measured(stand, EXACT_HEIGHT)
    rig = replace(EXACT_RIG, **of_rig)
    doubtful = measured(stand, replace(EXACT_HEIGHT, **of_way), rig_uncertainty=rig)
    assert doubtful.distance_m.std > 1.2 * sure.distance_m.std
    assert words in doubtful.evidence.distance_from


@pytest.mark.parametrize("term", WIDENED)
def test_the_stated_error_is_that_which_the_term_makes(
    stand: Any, measured: Any, exact: MeasureSettings, term: str
) -> None:
    """One deviation of an input moves the distance by one stated deviation of that input."""
    moved = {
        "height": (replace(EXACT_HEIGHT, height_m=1.98), {}),
        "slope": (replace(EXACT_HEIGHT, ahead_deg=-4.0), {}),
        "vertical": (EXACT_HEIGHT, {"up_camera": _turned(stand.up, 4.0)}),
        "principal point": (EXACT_HEIGHT, {}),
    }
    of_way, of_rig, _ = WIDENED[term]
    sure = measured(stand, EXACT_HEIGHT).distance_m
    rig = replace(EXACT_RIG, **of_rig)
    stated = measured(stand, replace(EXACT_HEIGHT, **of_way), rig_uncertainty=rig).distance_m
    way, options = moved[term]
    if term == "principal point":
        camera = replace(stand.camera, cy=stand.camera.cy + 30.0)
        trees = stand.detections()
        [tree] = measure_without_depth(
            trees, camera, [way], up_camera=stand.up, rig_uncertainty=EXACT_RIG, settings=exact
        )
        shift_m = tree.distance_m.value - sure.value
    else:
        shift_m = measured(stand, way, **options).distance_m.value - sure.value
    own_m = np.sqrt(stated.std**2 - sure.std**2)
    assert own_m == pytest.approx(abs(shift_m), rel=0.45)


def _turned(up: np.ndarray, degrees: float) -> np.ndarray:
    """A vertical that is turned about the camera's x axis."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]]) @ up


def test_a_level_cameras_diameter_does_not_depend_on_its_focal_length(
    scene: Any, pole: Any, exact: MeasureSettings
) -> None:
    stand = scene(pole(right_m=0.3), pitch_deg=0.0)
    unsure = replace(stand.camera, focal_std_px=70.0)
    trees, known = stand.detections(), {"up_camera": stand.up, "settings": exact}
    rig = RigUncertainty(0.0, 0.0, 0.0, 0.0)
    sure, doubtful = (
        measure_without_depth(trees, camera, [EXACT_HEIGHT], rig_uncertainty=rig, **known)[0]
        for camera in (stand.camera, unsure)
    )
    assert doubtful.distance_m.std > 1.5 * sure.distance_m.std
    assert doubtful.diameter_m.std < 1.1 * sure.diameter_m.std


def test_without_a_vertical_it_comes_from_the_other_stems(
    scene: Any, pole: Any, exact: MeasureSettings
) -> None:
    stand = scene(
        *(pole(right_m=x, ahead_m=a) for x, a in ((-1.4, 3.6), (-0.5, 3.3), (0.4, 3.6), (1.3, 3.3)))
    )
    given, estimated = (
        measure_without_depth(
            stand.detections(), stand.camera, [EXACT_HEIGHT], up_camera=up, settings=exact
        )[1]
        for up in (stand.up, None)
    )
    assert abs(estimated.distance_m.value - given.distance_m.value) < 2 * estimated.distance_m.std
    assert estimated.distance_m.std > 1.5 * given.distance_m.std


def test_a_foot_that_plants_hide_is_inferred_from_the_cut(
    scene: Any, pole: Any, measured: Any
) -> None:
    stem = pole(right_m=0.3, cut_m=0.15, section_m=0.3)
    stand = scene(stem)
    hidden = stand.masks()[0].copy()
    rows = np.flatnonzero(hidden.any(1))
    hidden[rows[-1] - 60 :] = False
    tree = measured(stand, EXACT_HEIGHT, trees=stand.detections([hidden]))
    seen = measured(stand, EXACT_HEIGHT)
    truth_m = float(np.linalg.norm(stand.axis_point(stem, stem.cut_m)))
    assert tree.distance_m.value == pytest.approx(truth_m, abs=2 * tree.distance_m.std)
    assert tree.distance_m.std > seen.distance_m.std
    assert "plants hide the foot" in tree.cut_height_m.reason


REASONS = {
    "the foot is not in the picture": ({"ahead_m": 1.8}, EXACT_HEIGHT, "not in the pict"),
    "a wrong vertical": (
        {"ahead_m": 15.0},
        replace(EXACT_HEIGHT, ahead_deg=-10.0),
        "at or above the horizon",
    ),
    "too uncertain": (
        {"ahead_m": 14.0, "diameter_m": 0.5},
        replace(EXACT_HEIGHT, slope_std_deg=8.0),
        "height above level ground is too uncertain, mostly because of the slope",
    ),
}


@pytest.mark.parametrize("case", REASONS)
def test_what_cannot_be_told_has_a_reason(scene: Any, pole: Any, measured: Any, case: str) -> None:
    of_pole, way, words = REASONS[case]
    tree = measured(scene(pole(**of_pole)), way)
    assert words in tree.distance_m.reason
    assert words in tree.diameter_m.reason


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"height_m": 0.0}, "metres above 0"),
        ({"height_m": float("nan")}, "metres above 0"),
        ({"height_m": 2.0, "height_std_m": 2.5}, "less than the height"),
        ({"height_m": 2.0, "ahead_deg": 60.0}, "from -45 to 45"),
        ({"height_m": 2.0, "slope_std_deg": -1.0}, "from 0 to 45"),
    ],
)
def test_values_out_of_range_are_refused(values: dict[str, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        CameraHeight(**values)


def marker_px(scene: Any, at_m: np.ndarray, side_m: float, turn_deg: float = 0.0) -> np.ndarray:
    """Corners of an upright marker whose middle is at a camera point."""
    turn = np.radians(turn_deg)
    right = scene.to_camera @ np.array([np.cos(turn), 0.0, np.sin(turn)])
    corners = side_m / 2 * np.array([[-1, 1], [1, 1], [1, -1], [-1, -1]])
    return project_points(scene.camera, at_m + corners[:, :1] * right + corners[:, 1:] * scene.up)


@pytest.mark.parametrize("turn_deg", [0.0, 25.0])
def test_a_marker_on_the_stem_tells_its_distance(
    stand: Any, measured: Any, turn_deg: float
) -> None:
    stem = stand.poles[0]
    centre = stand.axis_point(stem, 1.2)
    bark = centre + stem.diameter_at_m(1.2) / 2 * stand.front(stem, centre)
    mark = ScaleMark(marker_px(stand, bark, 0.2, turn_deg), 0.2, "the marker")
    tree = measured(stand, ScaleMarks([mark], "no marker"))
    assert tree.distance_m.value == pytest.approx(
        np.linalg.norm(stand.axis_point(stem, stem.cut_m)), rel=0.01
    )
    assert tree.dbh_m.value == pytest.approx(stem.diameter_at_m(1.3), rel=0.015)
    assert tree.evidence.distance_from.startswith("the marker on the stem")


def test_with_a_marker_the_focal_length_hardly_counts(stand: Any, measured: Any) -> None:
    stem = stand.poles[0]
    centre = stand.axis_point(stem, 1.2)
    bark = centre + stem.diameter_at_m(1.2) / 2 * stand.front(stem, centre)
    ways = [ScaleMarks([ScaleMark(marker_px(stand, bark, 0.2), 0.2, "the marker")], "none")]
    guess = PinholeCamera(1280, 720, 900.0, 900.0, 639.5, 359.5, focal_std_px=225.0)
    [tree] = measure_without_depth(stand.detections(), guess, ways, up_camera=stand.up)
    assert tree.dbh_m.value == pytest.approx(stem.diameter_at_m(1.3), rel=0.03)
    assert tree.dbh_m.std < 0.2 * tree.dbh_m.value
    assert tree.distance_m.std > 0.2 * tree.distance_m.value


def test_a_bar_beside_the_stem_has_a_larger_error(stand: Any, measured: Any) -> None:
    stem = stand.poles[0]
    foot = stand.foot(stem) + 0.5 * stand.to_camera @ np.array([1.0, 0.0, 0.0])
    ends_px = project_points(stand.camera, np.stack([foot, foot + 1.5 * stand.up]))
    beside = measured(stand, ScaleMarks([ScaleMark(ends_px, 1.5, "the scale bar")], "no bar"))
    distance_m = np.linalg.norm(stand.axis_point(stem, stem.cut_m))
    assert beside.distance_m.value == pytest.approx(distance_m, abs=2 * beside.distance_m.std)
    assert "beside the stem" in beside.evidence.distance_from
    moved = ScaleMark(ends_px - [500.0, 0.0], 1.5, "the scale bar")
    far = measured(stand, ScaleMarks([moved], "no bar at this stem"))
    assert far.diameter_m.reason == "no bar at this stem"


@pytest.mark.parametrize("across", [False, True])
def test_a_bar_seen_from_above_tells_the_distance(
    scene: Any, pole: Any, measured: Any, across: bool
) -> None:
    """An upright bar below the camera is seen short, one across the view is not."""
    stem = pole(right_m=0.4, ahead_m=3.8, taper=0.01)
    stand = scene(stem, camera_height_m=3.2, pitch_deg=32.0)
    bark_m = [
        (centre := stand.axis_point(stem, height_m))
        + stem.diameter_at_m(height_m) / 2 * stand.front(stem, centre)
        for height_m in (0.05, 1.05)
    ]
    if across:
        middle_m = (bark_m[0] + bark_m[1]) / 2
        half_m = np.cross(stand.along(stem), stand.front(stem, middle_m)) / 2
        bark_m = [middle_m - half_m, middle_m + half_m]
    ends_px = project_points(stand.camera, np.stack(bark_m))
    length_m = float(np.linalg.norm(bark_m[1] - bark_m[0]))
    tree = measured(stand, ScaleMarks([ScaleMark(ends_px, length_m, "the scale bar")], "no bar"))
    distance_m = np.linalg.norm(stand.axis_point(stem, stem.cut_m))
    assert tree.distance_m.value == pytest.approx(distance_m, rel=0.015)
    assert tree.diameter_m.value == pytest.approx(stem.diameter_at_m(stem.section_m), rel=0.02)


def test_of_several_ways_the_surest_counts_for_each_stem(stand: Any, measured: Any) -> None:
    marks = ScaleMarks([], "no marker")
    tree = measured(stand, marks, EXACT_HEIGHT)
    assert tree.evidence.distance_from.startswith("the camera's height")


def test_a_mark_whose_pose_cannot_be_found_leaves_the_other_way(
    stand: Any, measured: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenCV gives NaN for some squares."""
    mark = ScaleMark(np.array([[600.0, 300], [640, 300], [640, 340], [600, 340]]), 0.2, "marker 7")
    monkeypatch.setattr(ScaleMark, "place", lambda *_: (np.full(3, np.nan), np.nan))
    tree = measured(stand, ScaleMarks([mark], "no marker"), EXACT_HEIGHT)
    assert tree.evidence.distance_from.startswith("the camera's height")


def test_heights_count_from_below_a_stated_cover(stand: Any, measured: Any) -> None:
    bare = measured(stand, EXACT_HEIGHT)
    settings = MeasureSettings(ground_cover_m=0.3, ground_cover_std_m=0.05)
    covered = measured(stand, EXACT_HEIGHT, settings=settings)
    assert covered.cut_height_m.value == pytest.approx(bare.cut_height_m.value + 0.3, abs=0.01)
    assert covered.cut_height_m.std > 0.05
    assert covered.profile.height_m[0] == pytest.approx(bare.profile.height_m[0] + 0.3, abs=0.11)
    assert "below a cover of 0.30 ± 0.05 m" in covered.evidence.ground


# From level axes (right, down, ahead) to a fixed frame with z up.
FIXED = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def drive(scene: Any, poles: list[Any], steps: int, step_m: float) -> list[TreeMeasurement]:
    """The measurements in the last frame of a camera that moves to the right."""
    views, found = StemViews(), []
    for step in range(steps):
        right_m = step * step_m
        moved = [replace(pole, right_m=pole.right_m - right_m) for pole in poles]
        stand = scene(*moved, camera=PinholeCamera(640, 360, 350.0, 350.0, 319.5, 179.5))
        pose = RigidTransform(FIXED @ stand.to_camera.T, np.array([right_m, 0.0, 1.8]))
        found = measure_without_depth(
            stand.detections(), stand.camera, [views.at(pose)], up_camera=stand.up
        )
    return found


def test_several_poses_of_the_camera_tell_the_distances_of_stems(scene: Any, pole: Any) -> None:
    stems = [pole(right_m=-1.0, ahead_m=5.0), pole(right_m=1.2, ahead_m=7.0, diameter_m=0.4)]
    for stem, tree in zip(stems, drive(scene, stems, 5, 0.2), strict=True):
        distance_m = np.hypot(stem.right_m - 0.8, stem.ahead_m)
        assert tree.axis_distance_m.value == pytest.approx(distance_m, rel=0.05)
        assert abs(tree.diameter_m.value - stem.diameter_m) < 2 * tree.diameter_m.std
        assert "motion between several views" in tree.evidence.distance_from


class OneStem(SimpleNamespace):
    """What `MovingCamera` takes from `SeenStems`, of one upright stem."""

    def __len__(self) -> int:
        return 1


def stated_error(off_rad: float) -> float:
    """Relative error of a distance by 20 views, whose directions are off to both sides in turn."""
    views = StemViews()
    for step in range(20):
        camera_m = np.array([0.15 * step, 0.0, 2.0])
        x, y = np.array([1.0, 6.0]) - camera_m[:2]
        angle = np.arctan2(y, x) + off_rad * (-1) ** step
        sections = SimpleNamespace(
            view_direction=np.array([[np.cos(angle), np.sin(angle), 0.0]]),
            axes=SimpleNamespace(along=np.array([[0.0, 0.0, 1.0]])),
            half_rad=np.array([np.arcsin(0.15 / np.hypot(x, y))]),
            height_ratio=np.zeros(1),
        )
        frame = SimpleNamespace(to_camera=lambda axes: axes, rig=SimpleNamespace(focal=0.0))
        std_rad, up = np.array([np.radians(0.2)]), np.array([[0.0, 0.0, 1.0]])
        seen = OneStem(
            frame=frame, sections=sections, middle_std_rad=std_rad, numbers=np.array([0]), up=up
        )
        found = views.at(RigidTransform(np.eye(3), camera_m)).place(seen)
    return float(np.sqrt(found.distance_std[0] ** 2 - POSE_SCALE_STD**2))


def test_views_that_disagree_widen_the_error_by_as_much() -> None:
    stated_rad = np.radians(np.hypot(0.2, POSE_TURN_STD_DEG))
    assert stated_error(0.5 * stated_rad) == pytest.approx(stated_error(0.0), rel=0.1)
    assert stated_error(1.5 * stated_rad) == pytest.approx(1.5 * stated_error(0.0), rel=0.12)


@pytest.mark.parametrize(("steps", "words"), [(2, "three views"), (4, "has not moved far enough")])
def test_a_camera_that_hardly_moves_tells_no_distance(
    scene: Any, pole: Any, steps: int, words: str
) -> None:
    [tree] = drive(scene, [pole()], steps, 0.005)
    assert words in tree.distance_m.reason


def test_what_all_frames_share_does_not_average_away(stand: Any, measured: Any) -> None:
    tree = measured(stand, CameraHeight(1.8, slope_std_deg=3.0))
    assert 0.5 * tree.dbh_m.std < tree.rig_std["dbh_m"] <= tree.dbh_m.std


@pytest.mark.parametrize(
    ("points_px", "words"),
    [
        ([[0, 0], [100, 0], [0, 100], [100, 100]], "clockwise in the picture"),
        ([[0, 0], [0, 100], [100, 100], [100, 0]], "clockwise in the picture"),
        ([[0, 0], [100, 0], [100, 100]], "have shape"),
        ([0, 0, 100, 0], "have shape"),
    ],
)
def test_points_that_are_no_mark_are_refused(points_px: list[Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        ScaleMark(np.array(points_px, float), 0.2, "the marker")


def test_where_nothing_tells_a_distance_it_is_not_from_depth(stand: Any, measured: Any) -> None:
    tree = measured(stand, ScaleMarks([], "no marker"))
    assert tree.diameter_m.reason == "no marker"
    assert tree.evidence.distance_from == ""
