"""Labels against the picture and against independent formulas."""

import dataclasses

import numpy as np
import pytest

import calib
from basetree.errors import SettingsError
from perceptree.simulator.geometry.assemble import SceneMesh
from perceptree.simulator.geometry.ground import ground_mesh
from perceptree.simulator.geometry.mesh import merge
from perceptree.simulator.geometry.stems import stem_mesh
from perceptree.simulator.labelling.labels import TreeLabel, label_view
from perceptree.simulator.labelling.silhouette import outline_points
from perceptree.simulator.rendering.render import Drawing, Renderer
from perceptree.simulator.rendering.view import Pose, View, look_from, random_view
from perceptree.simulator.scene.description import Scene, Tree, describe_scene
from perceptree.simulator.scene.models import MODELS
from perceptree.simulator.scene.stem import Fork, Stem, random_stem
from perceptree.simulator.settings import LabelSettings, ideal_camera
from perceptree.simulator.streams import Stream, stream

LABELS = LabelSettings(min_visible_fraction=0.0, min_visible_area=0.0, reach_m=13.0)
SMALL = ideal_camera(320, 180)
LARGE = ideal_camera(1280, 720)
MIDDLE = ideal_camera(640, 360)
BARREL = (-0.3, 0.08, 0.0, 0.0)
FOLDING = (-0.373, 0.204, 0.002, 0.001, -0.072)  # of a car's camera; turns back at 52 degrees
LEVEL = Pose("hand", 1.6, 0.0, 0.0, 0.0)


class RoundStem(Stem):
    """A cylinder around a straight axis."""

    def radius_m(self, height_m, angle_rad):
        return np.full((len(height_m), len(angle_rad)), self.diameter_m / 2)


def round_stem(diameter_m: float, lean=(0.0, 0.0)) -> RoundStem:
    none = np.zeros(2)
    return RoundStem(
        MODELS[0],
        diameter_m,
        18.0,
        np.array(lean),
        none,
        none,
        none,
        np.zeros((0, 4)),
        np.zeros((0, 4)),
    )


def planted(stem: Stem, x_m: float, y_m: float = 0.0, uphill_m: float = 0.0) -> Tree:
    return Tree(
        stem,
        np.array([x_m, y_m, 0.0]),
        uphill_m,
        LABELS.cut_height_m,
        LABELS.diameter_height_m,
        LABELS.stem_height_m,
        True,
        0.0,
        0.0,
        1.0,
    )


@pytest.fixture(scope="module")
def plain(forests) -> Scene:
    """A scene whose ground is level at z = 0."""
    scene = forests[0][0]
    flat = dataclasses.replace(scene.terrain, z_m=np.zeros_like(scene.terrain.z_m))
    light = dataclasses.replace(scene.light, sun_colour=np.zeros(3))
    return dataclasses.replace(scene, terrain=flat, light=light)


@pytest.fixture(scope="module")
def draw(textures, plain):
    """Render stems on level ground without anything else."""

    def drawn(trees: list[Tree], view: View) -> Drawing:
        parts, owners = [ground_mesh(plain.terrain)], []
        owners.append(np.zeros(len(parts[0].faces), np.int32))
        for number, tree in enumerate(trees, start=1):
            mesh = stem_mesh(tree.stem, tree.label_heights_m, True)
            parts.append(dataclasses.replace(mesh, vertices=mesh.vertices + tree.position_m))
            owners.append(mesh.labelled * np.int32(number))
        whole = merge(parts)
        ones = np.ones(len(whole.vertices), np.float32)
        mesh = SceneMesh(
            whole.vertices,
            whole.normals,
            whole.uv,
            ones,
            ones,
            whole.faces,
            whole.layer,
            np.concatenate(owners).astype(np.int32),
            np.array([0, len(whole.faces)]),
            np.zeros((1, 3)),
            np.array([500.0]),
            np.zeros(0, np.int64),
        )
        return Renderer(textures, plain, mesh).draw(view)

    return drawn


def label_one(view: View, drawing: Drawing, tree: Tree) -> TreeLabel:
    labels = label_view(view, drawing, [tree], LABELS)
    assert len(labels) == 1
    return labels[0]


def edge_beyond(mask: np.ndarray, point: np.ndarray, other: np.ndarray) -> float:
    """Distance of ``point`` to the mask's edge on the line from ``other``, px; negative inside."""
    way = (point - other) / np.linalg.norm(point - other)
    steps = np.arange(-20.0, 20.0, 0.02)
    column, row = np.floor(point + steps[:, None] * way).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < mask.shape[1]) & (row < mask.shape[0])
    inside[inside] = mask[row[inside], column[inside]]
    assert inside.any()
    return float(steps[inside][-1])


def random_place(rng: np.random.Generator, camera) -> tuple[View, float, float]:
    """A view over level ground, and a position 2 to 10 m away whose ground is visible."""
    height_m = rng.uniform(1.2, 3.0)
    bearing, distance_m = np.radians(rng.uniform(-36, 36)), rng.uniform(2.0, 10.0)
    pitch_deg = -np.degrees(np.arctan2(height_m - 0.5, distance_m)) * rng.uniform(0.6, 1.1)
    pose = Pose("hand", height_m, pitch_deg, rng.uniform(-6, 6), 0.0)
    view = look_from(camera, np.array([0.0, 0.0, height_m]), pose)
    return view, distance_m * np.cos(bearing), distance_m * np.sin(bearing)


@pytest.mark.parametrize("camera", [SMALL, dataclasses.replace(SMALL, distortion=BARREL), LARGE])
def test_diameter_points_lie_on_the_rendered_silhouette_across_the_axis(draw, camera):
    rng, inside = np.random.default_rng(3), 0
    for number in range(24 if camera.width == SMALL.width else 8):
        model = MODELS[number % len(MODELS)]
        stem = random_stem(rng, model, rng.uniform(0.08, 0.5), 12.0, 20.0, 0.0)
        view, x_m, y_m = random_place(rng, camera)
        tree = planted(stem, x_m, y_m)
        label = label_one(view, draw([tree], view), tree)
        ends, size = label.keypoints[1:3, :2], (camera.width, camera.height)
        left, right = ends
        margin = np.minimum(ends, size - ends)
        if margin.min() < 3:
            continue
        inside += 1
        assert abs(edge_beyond(label.mask, left, right)) <= 1.0, number
        assert abs(edge_beyond(label.mask, right, left)) <= 1.0, number
        heights = np.array([tree.diameter_z_m - 0.05, tree.diameter_z_m + 0.05])
        low, high = view.project(tree.position_m + stem.axis(heights))
        along, across = (high - low) / np.linalg.norm(high - low), right - left
        assert abs(along @ across) / np.linalg.norm(across) < 0.25
        assert left[0] < right[0]
        section = view.project(tree.point(tree.diameter_z_m))
        normal = np.array([-across[1], across[0]]) / np.linalg.norm(across)
        off_line = normal @ (section - left)
        pixel_m = label.position_camera_m[2] / camera.fx
        assert abs(off_line) * pixel_m < 0.02
    assert inside >= 6


def test_a_camera_that_touches_a_leaning_stem_sees_two_points_of_the_bark():
    """No ray then touches the section at the height of the diameter."""
    stem = round_stem(0.43605504, lean=(-0.26171856, 0.04268829))
    tree = planted(stem, 0.0)
    origin = tree.point(0.69115849) + np.array([-0.18794422, 0.1223531, 0.0])
    view = look_from(SMALL, origin, Pose("hand", 0.69, -60.0, 0.0, 0.0))
    points = np.array(outline_points(view, tree, tree.diameter_z_m))
    from_axis_m = np.linalg.norm(points - tree.point(tree.diameter_z_m), axis=1)
    assert np.allclose(from_axis_m, 0.218, atol=0.002)
    assert np.linalg.norm(points[0] - points[1]) > 0.3


def edge_plane(view: View, mask: np.ndarray, side: int) -> np.ndarray:
    """Unit normal of the plane through the camera that fits a mask's left (0) or right (1) edge.

    The outermost pixels of the rows, each edge half a pixel beyond a pixel's centre on average.
    """
    rows = np.nonzero(mask.any(1))[0]
    rows = rows[len(rows) // 10 : -len(rows) // 10]
    columns = np.array([np.nonzero(mask[row])[0][-side] + side for row in rows], float)
    rays = calib.pixels_to_rays(view.intrinsics, np.stack([columns, rows + 0.5], -1))
    normal = np.linalg.svd(rays)[2][2]
    return normal * np.sign(normal[0])


@pytest.mark.parametrize("lean", [(0.0, 0.0), (0.1, 0.25), (-0.3, -0.15)])
@pytest.mark.parametrize("distance_m", [2.0, 3.5, 6.0, 9.0])
def test_a_smooth_stems_diameter_comes_back_from_its_silhouette(draw, distance_m: float, lean):
    """D = 2 d sin(a), with the axis's distance d and the angle 2 a between the tangent planes."""
    for diameter_m, roll_deg in ((0.15, 4.0), (0.4, -7.0)):
        tree = planted(round_stem(diameter_m, lean), distance_m, 0.3)
        pose = dataclasses.replace(LEVEL, roll_deg=roll_deg, pitch_deg=-5.0)
        view = look_from(MIDDLE, np.array([0.0, 0.0, 1.6]), pose)
        label = label_one(view, draw([tree], view), tree)
        left, right = (edge_plane(view, label.mask, side) for side in (0, 1))
        half_angle = np.arccos(left @ right) / 2
        axis = np.array([*lean, 1.0]) / np.linalg.norm([*lean, 1.0])
        axis_distance_m = np.linalg.norm(np.cross(tree.position_m - view.origin, axis))
        found_m = 2 * axis_distance_m * np.sin(half_angle)
        pixel_m = label.position_camera_m[2] / view.intrinsics.fx
        assert label.diameter_m == pytest.approx(diameter_m, rel=1e-3)
        assert found_m == pytest.approx(diameter_m, abs=max(0.005 * diameter_m, 0.3 * pixel_m))


def test_heights_distance_position_and_inclination_are_those_of_the_stem(draw):
    tree = planted(round_stem(0.3, (0.2, 0.1)), 4.0, 0.5, uphill_m=0.12)
    view = look_from(SMALL, np.array([0.0, 0.0, 1.6]), LEVEL)
    label = label_one(view, draw([tree], view), tree)
    cut = np.array([4.0 + 0.32 * 0.2, 0.5 + 0.32 * 0.1, 0.32])
    assert label.cut_height_m == 0.20
    assert label.diameter_height_m == 0.30
    assert label.position_world_m == pytest.approx(cut)
    assert label.distance_m == pytest.approx(np.linalg.norm(cut - [0, 0, 1.6]))
    assert label.position_camera_m == pytest.approx([-cut[1], 1.6 - cut[2], cut[0]])
    assert label.inclination_deg == pytest.approx(np.degrees(np.arctan(np.hypot(0.2, 0.1))))
    assert label.diameter_breast_m == pytest.approx(0.3, rel=1e-3)
    assert (label.species, label.model) == (MODELS[0].species, MODELS[0].name)


def test_the_tape_reads_the_convex_girth_of_a_furrowed_stem():
    """A dense section r (1 + a cos 5 t) against the girth of its hull by Cauchy's mean width."""
    stem = dataclasses.replace(round_stem(0.4), bumps=np.array([[0.05, 5.0, 0.0, 0.0]]))
    stem = Stem(**{field.name: getattr(stem, field.name) for field in dataclasses.fields(Stem)})
    angle = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    radius = stem.radius_m(np.array([1.3]), angle)[0]
    points = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    ways = np.stack([np.cos(angle[::10]), np.sin(angle[::10])], -1)
    mean_width_m = np.ptp(points @ ways.T, axis=0).mean()
    assert stem.girth_diameter_m(1.3) == pytest.approx(mean_width_m, rel=1e-3)
    assert mean_width_m > 0.404


def test_the_cut_is_above_the_uphill_ground_and_breast_height_too(forests):
    for scene, _ in forests:
        for tree in scene.near_trees:
            x, y, _ = tree.position_m
            turn = np.linspace(0, 2 * np.pi, 90)
            radius = 0.6 * tree.stem.diameter_m
            around = scene.terrain.height_m(x + radius * np.cos(turn), y + radius * np.sin(turn))
            assert tree.point(tree.cut_z_m)[2] - around.max() == pytest.approx(0.20, abs=0.02)


def test_a_hidden_point_keeps_its_place_and_is_flagged(draw):
    view = look_from(SMALL, np.array([0.0, 0.0, 1.6]), dataclasses.replace(LEVEL, pitch_deg=-8.0))
    tree, before = planted(round_stem(0.4), 5.0), planted(round_stem(0.3, (0.0, 0.36)), 2.5, -0.324)
    free = label_one(view, draw([tree], view), tree)
    labels = label_view(view, draw([tree, before], view), [tree, before], LABELS)
    hidden = labels[0]
    assert np.array_equal(free.keypoints[:, :2], hidden.keypoints[:, :2])
    assert free.keypoints[:, 2].tolist() == [2, 2, 2, 2, 2]
    assert hidden.keypoints[:, 2].tolist() == [1, 1, 1, 2, 2]
    assert hidden.visible_fraction < 0.8 < 0.97 < free.visible_fraction
    aside = look_from(SMALL, np.array([0.0, 0.0, 1.6]), dataclasses.replace(LEVEL, pitch_deg=35.0))
    above = label_one(aside, draw([tree], aside), tree)
    assert above.keypoints[:3].tolist() == [[0, 0, 0]] * 3


def test_masks_hold_their_trees_pixels_and_boxes_bound_them(small_settings, textures, forests):
    found = 0
    for scene, mesh in forests:
        view = random_view(np.random.default_rng(scene.seed), small_settings.camera, scene)
        drawing = Renderer(textures, scene, mesh).draw(view)
        claimed = np.zeros(drawing.object_id.shape, int)
        numbers = {tuple(tree.point(tree.cut_z_m)): n for n, tree in enumerate(scene.near_trees, 1)}
        for label in label_view(view, drawing, scene.near_trees, small_settings.labels):
            number = numbers[tuple(label.position_world_m)]
            assert np.array_equal(label.mask, drawing.object_id == number)
            assert label.distance_m <= small_settings.labels.reach_m
            claimed += label.mask
            rows, columns = np.nonzero(label.mask)
            bounds = [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]
            assert label.box_px.tolist() == bounds
            found += 1
        assert claimed.max() == 1
    assert found >= 4


@pytest.mark.parametrize("distortion", [BARREL, FOLDING])
def test_only_what_a_bent_ray_shows_is_projected_into_the_image(distortion):
    camera = dataclasses.replace(LARGE, fx=1000.0, fy=1000.0, distortion=distortion)
    view = look_from(camera, np.array([0.0, 0.0, 1.6]), LEVEL)
    points_m = np.random.default_rng(3).uniform([0.2, -9, -9], [6, 9, 9], (20_000, 3))
    pixels = view.project(points_m)
    inside = ((pixels >= 0) & (pixels < [camera.width, camera.height])).all(1)
    seen = view.to_camera(points_m[inside])
    rays = calib.pixels_to_rays(camera, pixels[inside])
    assert inside.sum() > 800
    assert np.allclose(rays, seen / seen[:, 2:], atol=1e-3)
    assert np.array_equal(pixels[inside], calib.project_points(camera, seen))


def test_keypoints_and_area_of_a_stem_before_a_bent_lens_that_folds(draw):
    camera = dataclasses.replace(LARGE, fx=1000.0, fy=1000.0, distortion=FOLDING)
    view = look_from(camera, np.array([0.0, 0.0, 3.0]), dataclasses.replace(LEVEL, pitch_deg=0.0))
    tree = planted(round_stem(0.3), 1.2)
    label = label_one(view, draw([tree], view), tree)
    assert label.keypoints[:, 2].tolist() == [0, 0, 0, 0, 0]
    assert label.visible_fraction > 0.98


def test_the_cut_point_lies_on_the_front_of_the_stem(draw):
    view = look_from(SMALL, np.array([0.0, 0.0, 1.6]), dataclasses.replace(LEVEL, pitch_deg=-15.0))
    tree = planted(round_stem(0.4), 3.0)
    drawing = draw([tree], view)
    x, y, _ = label_one(view, drawing, tree).keypoints[0]
    depth_m = drawing.depth_m[int(y), int(x)]
    point = calib.pixels_to_points(view.intrinsics, np.array([[x, y]]), depth_m[None])[0]
    assert point == pytest.approx(view.to_camera(np.array([2.8, 0.0, 0.2])), abs=0.02)


@pytest.mark.parametrize("forked", [False, True])
def test_the_visible_fraction_of_a_stem_with_nothing_before_it_is_one(draw, forked: bool):
    rng = np.random.default_rng(8)
    for number in range(8):
        stem = random_stem(rng, MODELS[2 * number], rng.uniform(0.12, 0.5), 6.0, 20.0, 0.0)
        if forked:
            stem = dataclasses.replace(stem, fork=Fork(1.7, rng.uniform(0, 6), 0.5, 0.8, 12.0))
        view, x_m, y_m = random_place(rng, SMALL)
        tree = planted(stem, x_m, y_m)
        assert label_one(view, draw([tree], view), tree).visible_fraction > 0.96


def test_the_visible_fraction_is_the_share_of_pixels_left(draw):
    view = look_from(SMALL, np.array([0.0, 0.0, 1.6]), dataclasses.replace(LEVEL, pitch_deg=-8.0))
    fork = Fork(1.7, np.pi / 2, 0.6, 0.9, 12.0)
    tree = planted(dataclasses.replace(round_stem(0.4), fork=fork), 5.0)
    before = planted(round_stem(0.1), 2.5)
    alone, both = draw([tree], view), draw([tree, before], view)
    left = (both.object_id == 1).sum() / (alone.object_id == 1).sum()
    assert 0.3 < left < 0.8
    label = label_view(view, both, [tree, before], LABELS)[0]
    assert label.visible_fraction == pytest.approx(left, abs=0.03)


def test_every_tree_in_reach_can_be_labelled(small_settings):
    within = {10.0: [], 12.0: [], 13.0: []}
    for seed in range(12):
        scene = describe_scene(small_settings, seed)
        cuts_m = np.array([tree.point(tree.cut_z_m) for tree in scene.trees])
        near = np.array([tree.near for tree in scene.trees])
        for number in range(8):
            rng = stream(seed, Stream.VIEW, number)
            view = random_view(rng, small_settings.camera, scene)
            distance_m = np.linalg.norm(cuts_m - view.origin, axis=1)
            for reach_m, found in within.items():
                found += near[distance_m <= reach_m].tolist()
    assert len(within[10.0]) > 500
    assert all(within[12.0])
    assert np.mean(within[13.0]) > 0.99
    assert LabelSettings(reach_m=13.0)
    with pytest.raises(SettingsError, match="reach_m is 14: expected 1 to 13"):
        LabelSettings(reach_m=14.0)


def test_trees_out_of_reach_or_hardly_visible_are_not_labelled(draw):
    view = look_from(SMALL, np.array([0.0, 0.0, 1.6]), LEVEL)
    tree = planted(round_stem(0.3), 6.0)
    drawing = draw([tree], view)
    for name, value in (("reach_m", 5.9), ("min_visible_area", 0.5)):
        assert not label_view(view, drawing, [tree], dataclasses.replace(LABELS, **{name: value}))
    hidden = dataclasses.replace(drawing, object_id=np.zeros_like(drawing.object_id))
    hidden.object_id[80, 150:160] = 1
    strict = dataclasses.replace(LABELS, min_visible_fraction=0.08)
    assert not label_view(view, hidden, [tree], strict)
    assert label_view(view, hidden, [tree], LABELS)
