"""Crowns: shape, foliage, and fit to their stems."""

import numpy as np
import pytest

from perceptree.simulator.geometry.crowns import CROWN_HEIGHT_M, crown, fit_crown, sapling
from perceptree.simulator.materials.layers import CROWN_FOLIAGE, Layer
from perceptree.simulator.scene.models import MODELS, TreeModel
from perceptree.simulator.scene.stem import random_stem

by_model = pytest.mark.parametrize("model", MODELS, ids=[model.name for model in MODELS])


@by_model
def test_crowns_keep_to_their_budget_and_to_the_tree(model: TreeModel):
    rng = np.random.default_rng(1)
    near, far = crown(rng, model, True), crown(rng, model, False)
    assert 2000 < len(near.faces) < (9000 if model.conifer else 8000)
    assert 200 < len(far.faces) < 900
    for mesh in (near, far):
        assert not mesh.labelled.any()
        assert np.isfinite(mesh.vertices).all()
        np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=-1), 1, atol=1e-5)
        assert mesh.vertices[:, 2].min() > 0
        assert mesh.vertices[:, 2].max() < 1.25 * CROWN_HEIGHT_M
        foliage = np.isin(mesh.layer, CROWN_FOLIAGE)
        lowest_m = np.quantile(mesh.vertices[mesh.faces[foliage]][..., 2], 0.1)
        assert lowest_m > 0.6 * model.crown_base[0] * CROWN_HEIGHT_M


@pytest.mark.parametrize("model", MODELS[::3], ids=[model.species for model in MODELS[::3]])
def test_fine_crowns_have_more_and_smaller_twigs_within_the_same_reach(model: TreeModel):
    plain, fine = (crown(np.random.default_rng(1), model, True, fine=f) for f in (False, True))
    areas_m2, reach_m = [], []
    for mesh in (plain, fine):
        corners = mesh.vertices[mesh.faces[np.isin(mesh.layer, CROWN_FOLIAGE)]]
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        areas_m2.append(0.5 * np.linalg.norm(sides, axis=-1))
        reach_m.append(np.quantile(np.hypot(corners[..., 0], corners[..., 1]), 0.9))
    assert 1.4 < len(areas_m2[1]) / len(areas_m2[0]) < 2.0
    assert 0.35 < np.median(areas_m2[1]) / np.median(areas_m2[0]) < 0.65
    assert reach_m[1] == pytest.approx(reach_m[0], rel=0.3)


@by_model
def test_winter_bares_broadleaves_alone(model: TreeModel):
    layers = set(crown(np.random.default_rng(1), model, True, leaves=False).layer.tolist())
    assert Layer.BARE_TWIG in layers
    assert bool(layers & set(CROWN_FOLIAGE)) == model.conifer


def test_crowns_differ_by_species_in_foliage_and_spread():
    rng = np.random.default_rng(2)
    foliage, spread = {}, {}
    for model in MODELS[::3]:
        mesh = crown(rng, model, True)
        foliage[model.species] = set(mesh.layer.tolist()) & set(CROWN_FOLIAGE)
        leaves = mesh.vertices[mesh.faces[np.isin(mesh.layer, CROWN_FOLIAGE), 0]]
        spread[model.species] = float(np.hypot(leaves[:, 0], leaves[:, 1]).mean())
    assert sorted(next(iter(only)) for only in foliage.values()) == sorted(CROWN_FOLIAGE)
    assert all(len(only) == 1 for only in foliage.values())
    assert spread["beech"] > 1.2 * spread["fir"]


def test_firs_keep_their_body_when_seen_edge_on():
    """Twigs are folded, so that from any side much of the area seen from above is visible."""
    mesh = crown(np.random.default_rng(3), MODELS[0], True)
    corners = mesh.vertices[mesh.faces[mesh.layer == Layer.FIR_TWIG]]
    area = np.abs(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])).sum(0)
    assert area[0] > 0.25 * area[2]
    assert area[1] > 0.25 * area[2]


def test_a_crown_follows_the_lean_and_height_of_its_stem():
    stem = random_stem(np.random.default_rng(3), MODELS[0], 0.3, 15.0, 20.0, 0.0)
    prototype = crown(np.random.default_rng(1), MODELS[0], True)
    fitted = fit_crown(prototype, stem, 1.0, 0.5)
    height_m = prototype.vertices[:, 2] * stem.height_m / CROWN_HEIGHT_M
    offset = fitted.vertices - stem.axis(height_m)
    reach_m = np.hypot(*prototype.vertices[:, :2].T) * stem.height_m / CROWN_HEIGHT_M
    np.testing.assert_allclose(np.hypot(*offset[:, :2].T), reach_m, atol=1e-4)
    np.testing.assert_allclose(fitted.tint, 0.5 * prototype.tint)


@pytest.mark.parametrize("species", ["fir", "spruce", "pine"])
def test_saplings_are_low_branched_to_the_ground_and_never_labelled(species: str):
    rng = np.random.default_rng(4)
    for _ in range(5):
        mesh = sapling(rng, species)
        assert 0.8 < mesh.vertices[:, 2].max() < 3.8
        foliage = mesh.vertices[mesh.faces[np.isin(mesh.layer, CROWN_FOLIAGE)]][..., 2]
        assert foliage.min() < 0.25 * foliage.max()
        assert not mesh.labelled.any()
        assert len(mesh.faces) < 1500


def test_the_same_seed_grows_the_same_tree():
    first, second = (crown(np.random.default_rng(9), MODELS[4], True).vertices for _ in range(2))
    np.testing.assert_array_equal(first, second)
