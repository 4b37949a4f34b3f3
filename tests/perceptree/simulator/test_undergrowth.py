"""Undergrowth and ground materials: sizes, face budgets, seams and labels."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from perceptree.simulator.geometry.prototypes import UNDERGROWTH
from perceptree.simulator.materials.ground import ground_layers
from perceptree.simulator.materials.layers import SIZE_PX, Layer
from perceptree.simulator.materials.plants import plant_layers

FORMS = 12
MOST_FACES = {
    "grass": 12,
    "dry_grass": 12,
    "fern": 70,
    "scrub": 120,
    "seedling": 70,
    "branch": 150,
    "log": 150,
    "stump": 300,
    "rock": 200,
    "root": 300,
}
HEIGHT_M = {
    "grass": (0.15, 0.5),
    "dry_grass": (0.1, 0.5),
    "fern": (0.25, 0.9),
    "scrub": (0.3, 1.0),
    "seedling": (0.45, 1.2),
    "log": (0.08, 0.6),
    "stump": (0.14, 0.9),
    "rock": (0.03, 0.6),
}
TILING = [Layer.LITTER, Layer.MOSS, Layer.ROOTS, Layer.MUD, Layer.ROCK, Layer.DEAD_WOOD]


@pytest.fixture(scope="module")
def meshes():
    rng = np.random.default_rng(3)
    return {name: [kind.make(rng) for _ in range(FORMS)] for name, kind in UNDERGROWTH.items()}


@pytest.fixture(scope="module")
def grounds():
    return ground_layers(np.random.default_rng(0))


@pytest.fixture(scope="module")
def plants():
    return plant_layers(np.random.default_rng(0))


@pytest.mark.parametrize("name", UNDERGROWTH)
def test_mesh_keeps_its_budget_and_is_sound(meshes, name):
    for mesh in meshes[name]:
        assert len(mesh.faces) <= MOST_FACES[name]
        assert mesh.faces.min() >= 0
        assert mesh.faces.max() < len(mesh.vertices)
        assert np.isfinite(mesh.vertices).all()
        assert np.isfinite(mesh.uv).all()
        assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize("name", UNDERGROWTH)
def test_nothing_is_labelled_as_a_tree(meshes, name):
    assert not any(mesh.labelled.any() for mesh in meshes[name])


@pytest.mark.parametrize("name", UNDERGROWTH)
def test_same_seed_gives_the_same_mesh(name):
    first, second = (UNDERGROWTH[name].make(np.random.default_rng(7)) for _ in range(2))
    assert np.array_equal(first.vertices, second.vertices)
    assert np.array_equal(first.layer, second.layer)


@pytest.mark.parametrize(("name", "heights"), HEIGHT_M.items())
def test_height_above_ground(meshes, name, heights):
    low, high = heights
    for mesh in meshes[name]:
        assert low <= mesh.vertices[:, 2].max() <= high


@pytest.mark.parametrize(("name", "depth_m"), [("stump", 0.4), ("rock", 0.1), ("root", 0.05)])
def test_reaches_below_ground_on_all_sides(meshes, name, depth_m):
    for mesh in meshes[name]:
        buried = mesh.vertices[mesh.vertices[:, 2] <= -depth_m]
        azimuth = np.sort(np.arctan2(buried[:, 1], buried[:, 0]))
        gaps = np.diff(azimuth, append=azimuth[0] + 2 * np.pi)
        assert gaps.max() < np.pi


def test_cut_faces_look_outwards(meshes):
    for mesh in meshes["stump"]:
        cut = np.unique(mesh.faces[mesh.layer == Layer.CUT_WOOD])
        assert (mesh.normals[cut, 2] > 0.8).all()
    for mesh in meshes["log"]:
        cut = np.unique(mesh.faces[mesh.layer == Layer.CUT_WOOD])
        assert (mesh.normals[cut, 0] * mesh.vertices[cut, 0] > 0).all()


def test_some_stumps_are_cut_and_some_rotten(meshes):
    cut = [Layer.CUT_WOOD in mesh.layer for mesh in meshes["stump"]]
    assert any(cut)
    assert not all(cut)


@pytest.mark.parametrize("layer", TILING)
def test_material_repeats_without_a_seam(grounds, layer):
    colour, relief = grounds[layer]
    assert colour.shape == (SIZE_PX, SIZE_PX, 3)
    assert 0 <= colour.min() <= colour.max() <= 1.01
    for field in (*np.moveaxis(colour, -1, 0), relief):
        for axis in (0, 1):
            steps = np.abs(np.diff(field, axis=axis)).mean(1 - axis)
            seam = np.abs(np.take(field, 0, axis) - np.take(field, -1, axis)).mean()
            assert seam < steps.max()


def test_grounds_tell_apart(grounds):
    red, green, _ = np.moveaxis(np.stack([grounds[k][0].mean((0, 1)) for k in TILING[:4]]), -1, 0)
    assert green[1] > red[1]
    assert (red > green)[[0, 2, 3]].all()


def test_growth_rings_are_round(grounds):
    colour, _ = grounds[Layer.CUT_WOOD]
    rows, columns = np.mgrid[:SIZE_PX, :SIZE_PX] - (SIZE_PX - 1) / 2
    radius, angle = np.hypot(rows, columns), np.arctan2(rows, columns)
    disc = radius < 0.4 * SIZE_PX
    rise_y, rise_x = np.gradient(cv2.blur(colour[..., 0], (3, 3)))
    outwards = (np.cos(angle) * rise_x + np.sin(angle) * rise_y)[disc]
    around = (np.cos(angle) * rise_y - np.sin(angle) * rise_x)[disc]
    assert np.abs(outwards).mean() > 1.5 * np.abs(around).mean()


def test_materials_are_deterministic(grounds, plants):
    again = ground_layers(np.random.default_rng(0))
    assert all(np.array_equal(again[k][0], grounds[k][0]) for k in grounds)
    assert all(np.array_equal(again[k][1], grounds[k][1]) for k in grounds)
    sprouts = plant_layers(np.random.default_rng(0))
    assert all(np.array_equal(sprouts[k], plants[k]) for k in plants)


@pytest.mark.parametrize("layer", [Layer.GRASS, Layer.DRY_GRASS, Layer.FERN, Layer.SCRUB])
def test_plant_grows_from_its_foot_and_stays_inside(plants, layer):
    alpha = plants[layer][..., 3]
    assert 0.1 < alpha.mean() < 0.6
    assert alpha[:, 0].max() > 0.5
    for border in (alpha[0], alpha[-1], alpha[:, -1]):
        assert border.max() < 0.1
