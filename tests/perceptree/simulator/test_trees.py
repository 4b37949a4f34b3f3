"""Trees: shapes within bounds, meshes on their analytic surface, seamless bark."""

import dataclasses

import numpy as np
import pytest

from perceptree.simulator.geometry.mesh import Mesh
from perceptree.simulator.geometry.stems import STEM_SIDES, stem_mesh
from perceptree.simulator.materials.barks import bark_layers
from perceptree.simulator.materials.foliage import foliage_layers
from perceptree.simulator.materials.layers import CROWN_FOLIAGE, LAST_BARK, Layer
from perceptree.simulator.scene.models import MODELS, TreeModel
from perceptree.simulator.scene.stem import Fork, Stem, random_stem
from perceptree.simulator.settings import SPECIES

LABEL_HEIGHTS_M = (0.21, 0.34, 4.0)
by_model = pytest.mark.parametrize("model", MODELS, ids=[model.name for model in MODELS])


def drawn(model: TreeModel, seed: int = 3, diameter_m: float = 0.3, **settings: float) -> Stem:
    shape = {"lean_std_deg": 4.0, "lean_max_deg": 20.0, "fork_share": 0.0} | settings
    return random_stem(np.random.default_rng(seed), model, diameter_m, **shape)


def plain(bumps: np.ndarray, diameter_m: float = 0.4) -> Stem:
    """An upright stem without root collar; its section depends only on ``bumps``."""
    none = np.zeros(2)
    return Stem(MODELS[0], diameter_m, 20.0, none, none, none, none, np.zeros((0, 4)), bumps, None)


def forked(stem: Stem, height_m: float = 2.2) -> Stem:
    return dataclasses.replace(stem, fork=Fork(height_m, 1.0, 0.35, 0.7, 0.9 * stem.height_m))


def highest_labelled_m(mesh: Mesh) -> float:
    return float(mesh.vertices[mesh.faces[mesh.labelled]][..., 2].max())


# --- the models -------------------------------------------------------------


def test_eighteen_models_three_of_every_species_each_with_a_bark_of_its_own():
    assert len(MODELS) == 18
    assert len({model.name for model in MODELS}) == 18
    assert {model.bark for model in MODELS} == set(list(Layer)[: LAST_BARK + 1])
    counts = {name: sum(model.species == name for model in MODELS) for name in SPECIES}
    assert counts == dict.fromkeys(SPECIES, 3)
    for model in MODELS:
        assert model.bark.name.startswith(model.species.upper())
        assert model.conifer == (model.species in ("fir", "spruce", "pine"))


@by_model
def test_the_numbers_of_a_model_are_ones_a_tree_can_have(model: TreeModel):
    assert 0.3 <= model.bark_m <= 1.2
    assert 15 <= model.height_m <= 30
    assert 0 <= model.flare[0] < model.flare[1] < 1
    assert 0.1 <= model.crown_base[0] < model.crown_base[1] < 0.8
    assert bool(model.dead_branches) == model.conifer


# --- stems as formulas ------------------------------------------------------


@by_model
def test_a_stem_tapers_from_a_swollen_foot_to_a_thin_tip(model: TreeModel):
    for seed in range(5):
        stem = drawn(model, seed)
        girth = [stem.girth_diameter_m(share * stem.height_m) for share in (0.1, 0.3, 0.6, 0.95)]
        assert np.all(np.diff(girth) < 0)
        assert girth[-1] < 0.1
        assert 1.0 < stem.girth_diameter_m(0.3) / stem.girth_diameter_m(1.3) < 1.5


@by_model
@pytest.mark.parametrize("diameter_m", [0.05, 0.25, 0.6])
def test_the_diameter_asked_for_is_the_tapes_at_breast_height(model, diameter_m):
    assert drawn(model, 1, diameter_m).girth_diameter_m(1.3) == pytest.approx(diameter_m, rel=0.05)


def test_thicker_stems_are_taller():
    heights = [drawn(MODELS[3], 7, diameter_m).height_m for diameter_m in (0.05, 0.15, 0.3, 0.6)]
    assert np.all(np.diff(heights) > 0)
    assert 4 < heights[0] < 9
    assert 20 < heights[-1] < 29


def test_lean_is_spread_as_asked_and_never_above_its_bound():
    model = dataclasses.replace(MODELS[0], lean=1.0)
    rng = np.random.default_rng(0)
    lean = np.array([random_stem(rng, model, 0.2, 5.0, 12.0, 0.0).lean for _ in range(2000)])
    lean_deg = np.degrees(np.arctan(np.hypot(*lean.T)))
    assert lean_deg.max() == pytest.approx(12.0, abs=1e-9)
    assert np.median(lean_deg) == pytest.approx(0.6745 * 5.0, rel=0.08)
    assert np.abs(lean.mean(0)).max() < 0.01


def test_upright_stands_have_upright_stems():
    assert not drawn(MODELS[0], lean_std_deg=0.0).lean.any()


@by_model
@pytest.mark.parametrize("diameter_m", [0.05, 0.3])
def test_forks_split_off_above_the_diameters_and_inside_the_stem(model, diameter_m):
    stems = [drawn(model, seed, diameter_m, fork_share=100.0) for seed in range(40)]
    forks = [(stem.fork, stem.height_m) for stem in stems if stem.fork]
    assert len(forks) > 30
    for fork, height_m in forks:
        assert 1.6 <= fork.height_m <= 6.0
        assert fork.height_m < fork.top_m < height_m
        assert 0.3 < fork.radius_share < 1.0


def test_no_fork_where_none_is_wanted():
    assert not any(drawn(MODELS[9], seed).fork for seed in range(50))


def test_a_fork_leaves_the_labelled_leader_as_it_is_below_and_whole_above():
    stem = drawn(MODELS[9])
    twin = forked(stem, 2.2)
    height_m = np.linspace(-0.5, 2.0, 30)
    np.testing.assert_array_equal(twin.rings(height_m, 24), stem.rings(height_m, 24))
    through = np.linspace(1.8, 4.0, 400)
    radius_m = twin.radius_m(through, np.zeros(1))[:, 0]
    assert np.abs(np.diff(radius_m)).max() < 0.002
    np.testing.assert_array_equal(twin.axis(through), stem.axis(through))
    apart = np.linalg.norm(twin.fork_axis(through) - twin.axis(through), axis=-1)
    assert apart[0] == 0
    assert np.all(np.diff(apart) >= 0)
    assert apart[-1] > 0.4


def test_a_stem_without_a_fork_has_no_second_leader():
    with pytest.raises(ValueError, match="no fork"):
        drawn(MODELS[0]).fork_axis(np.ones(1))


# --- girth ------------------------------------------------------------------


def test_girth_of_an_oval_section_is_its_arc_length():
    """r = R (1 + a sin 2t) is convex for small a: its girth is the integral of its arc length."""
    amplitude, radius_m = 0.06, 0.2
    stem = plain(np.array([[amplitude, 2.0, 0.0, 0.3]]), 2 * radius_m)
    turn = np.linspace(0, 2 * np.pi, 200_001)
    length = np.hypot(1 + amplitude * np.sin(2 * turn), 2 * amplitude * np.cos(2 * turn))
    girth_m = radius_m * np.trapezoid(length, turn)
    assert stem.girth_diameter_m(1.3) == pytest.approx(girth_m / np.pi, rel=3e-4)


def test_a_tape_spans_the_flutes_so_girth_exceeds_the_mean_diameter_but_not_the_outline():
    stem = plain(np.array([[0.08, 6.0, 0.0, 0.0]]))
    ring = stem.rings(np.array([1.3]), 2000)[0]
    outline_m = np.linalg.norm(np.diff(ring, axis=0), axis=-1).sum()
    radius_m = stem.radius_m(np.array([1.3]), np.linspace(0, 2 * np.pi, 2001)[:-1])
    hexagon_m = 12 * radius_m.max() * np.sin(np.pi / 6)
    girth_m = np.pi * stem.girth_diameter_m(1.3)
    assert 2 * radius_m.mean() * 1.02 < girth_m / np.pi
    assert hexagon_m < girth_m < 0.995 * outline_m


def test_sections_lie_across_the_axis_at_the_radius_of_the_formula():
    stem = drawn(MODELS[11], lean_std_deg=15.0)
    height_m = np.array([0.3, 1.3, 4.0])
    offsets = stem.rings(height_m, 36) - stem.axis(height_m)[:, None]
    radius_m = stem.radius_m(height_m, np.linspace(0, 2 * np.pi, 37))
    np.testing.assert_allclose(np.linalg.norm(offsets, axis=-1), radius_m, rtol=1e-9)
    for level, height in enumerate(height_m):
        assert np.abs(offsets[level] @ stem.direction(height)).max() < 1e-6


# --- stems as meshes --------------------------------------------------------


@pytest.mark.parametrize("model", MODELS[2::3])
def test_every_corner_of_a_near_stem_lies_on_a_ring_of_its_formula(model: TreeModel):
    stem = drawn(model)
    mesh = stem_mesh(stem, LABEL_HEIGHTS_M, near=True)
    lower = mesh.vertices[: np.unique(mesh.faces[mesh.labelled]).size]
    rings = lower.reshape(-1, STEM_SIDES + 1, 3)
    reach_m = -0.7 + np.arange(48_000) / 1e4
    axis = stem.axis(reach_m)
    for ring in rings:
        centre = ring[:-1].mean(0)
        height_m = reach_m[np.argmin(np.linalg.norm(axis - centre, axis=-1))]
        near = np.linspace(height_m - 0.03, height_m + 0.03, 301)
        candidates = stem.rings(near, STEM_SIDES)
        assert np.abs(candidates - ring).max((1, 2)).min() < 2e-4


@by_model
def test_a_near_stem_has_a_ring_at_every_label_height(model: TreeModel):
    stem = drawn(model)
    vertices = stem_mesh(stem, LABEL_HEIGHTS_M, near=True).vertices
    for ring in stem.rings(np.array(LABEL_HEIGHTS_M), STEM_SIDES):
        distance_m = np.linalg.norm(vertices[:, None] - ring[None, ::8], axis=-1).min(0)
        assert distance_m.max() < 1e-5


@by_model
def test_labelled_faces_end_at_the_labels_top_on_both_leaders(model: TreeModel):
    stem = forked(drawn(model))
    mesh = stem_mesh(stem, LABEL_HEIGHTS_M, near=True)
    tops = np.concatenate([stem.rings(np.array([4.0]), 48), stem.fork_rings(np.array([4.0]), 48)])
    assert highest_labelled_m(mesh) == pytest.approx(tops[..., 2].max(), abs=0.01)
    unlabelled = mesh.vertices[mesh.faces[~mesh.labelled]]
    assert unlabelled[..., 2].min() > 4.0 - 0.3
    lone = stem_mesh(dataclasses.replace(stem, fork=None), LABEL_HEIGHTS_M, near=True)
    assert mesh.labelled.sum() > lone.labelled.sum()


def test_a_stem_lower_than_its_labels_is_labelled_up_to_its_tip():
    stem = drawn(MODELS[0], diameter_m=0.05)
    mesh = stem_mesh(stem, (0.2, 0.3, 12.0), near=True)
    assert highest_labelled_m(mesh) > 0.97 * stem.height_m


def test_a_broken_stem_ends_in_splinters_and_keeps_its_labels():
    whole = drawn(MODELS[0])
    broken = dataclasses.replace(whole, broken_m=5.0)
    near, intact = (stem_mesh(stem, LABEL_HEIGHTS_M, near=True) for stem in (broken, whole))
    labelled = [mesh.vertices[mesh.faces[mesh.labelled]] for mesh in (near, intact)]
    assert np.array_equal(*labelled)
    torn = near.layer == Layer.CUT_WOOD
    assert torn.any()
    assert not near.labelled[torn].any()
    assert 5.0 < near.vertices[:, 2].max() < 5.0 + 2 * whole.diameter_m
    bark = near.vertices[near.faces[~torn]]
    assert bark[..., 2].max() == pytest.approx(5.0, abs=0.1)
    assert stem_mesh(broken, LABEL_HEIGHTS_M, near=False).vertices[:, 2].max() < 5.2


def test_far_stems_are_coarse_and_unlabelled():
    mesh = stem_mesh(forked(drawn(MODELS[0])), LABEL_HEIGHTS_M, near=False)
    assert not mesh.labelled.any()
    assert len(mesh.faces) < 150


def test_bark_keeps_its_size_on_thick_stems():
    """Metres of bark per repeat, around and along, whatever the diameter."""
    for diameter_m in (0.2, 0.35, 0.6):
        stem = plain(np.zeros((0, 4)), diameter_m)
        mesh = stem_mesh(stem, LABEL_HEIGHTS_M, near=True)
        around = np.ptp(mesh.uv[: STEM_SIDES + 1, 0])
        along = np.ptp(mesh.uv[:, 1]) / (stem.height_m + 0.6)
        assert around == pytest.approx(round(around), abs=1e-5)
        assert np.pi * diameter_m / around == pytest.approx(stem.model.bark_m, rel=0.35)
        assert 1 / along == pytest.approx(stem.model.bark_m, rel=0.35)


# --- materials --------------------------------------------------------------


@pytest.fixture(scope="module")
def barks():
    return bark_layers(np.random.default_rng(0))


@pytest.fixture(scope="module")
def twigs():
    return foliage_layers(np.random.default_rng(0))


def test_every_bark_is_drawn_in_range(barks):
    assert list(barks) == list(Layer)[: LAST_BARK + 1]
    for colour, relief in barks.values():
        assert colour.shape == (*relief.shape, 3)
        assert 0 <= colour.min() < colour.max() <= 1
        assert np.isfinite(relief).all()


def test_barks_tile_without_a_seam(barks):
    """Neighbours differ across the border no more than across the roughest line inside."""
    for colour, relief in barks.values():
        for image in (colour.mean(-1), relief):
            for axis in (0, 1):
                steps = np.abs(image - np.roll(image, 1, axis))
                for rough in (steps.mean(1 - axis), np.quantile(steps, 0.97, 1 - axis)):
                    assert rough[0] <= rough[1:].max()


def test_marks_that_reach_over_the_border_go_on_behind_it(barks):
    """Birch's dark marks are wide: most of those at one border continue at the other."""
    dark = barks[Layer.BIRCH_WHITE][0].mean(-1) < 0.5
    first, last = dark[:, 0], dark[:, -1]
    assert (first | last).sum() > 10
    assert (first & last).sum() > 0.5 * (first | last).sum()


def test_barks_differ_from_each_other(barks):
    """Barks differ in mean colour, its spread, or relief."""
    looks = np.array(
        [
            [*colour.mean((0, 1)), colour.std(), 0.1 * relief.std()]
            for colour, relief in barks.values()
        ]
    )
    apart = np.linalg.norm(looks[:, None] - looks[None], axis=-1)
    assert apart[~np.eye(len(looks), dtype=bool)].min() > 0.012


def test_birch_is_pale_and_moss_and_lichen_show_where_named(barks):
    tone = {layer: colour.mean((0, 1)) for layer, (colour, _) in barks.items()}
    assert tone[Layer.BIRCH_WHITE].mean() > 1.4 * tone[Layer.BEECH_SMOOTH].mean()
    for mossy, clean in (
        (Layer.FIR_MOSSY, Layer.FIR_GREY),
        (Layer.BEECH_MOSSY, Layer.BEECH_SMOOTH),
        (Layer.BIRCH_MOSSY, Layer.BIRCH_WHITE),
        (Layer.MAPLE_MOSSY, Layer.MAPLE_FURROWED),
    ):
        green = [tone[layer][1] - tone[layer][[0, 2]].mean() for layer in (mossy, clean)]
        assert green[0] > green[1] + 0.01
    pale = [
        (barks[layer][0].mean(-1) > 0.55).mean()
        for layer in (Layer.SPRUCE_LICHEN, Layer.SPRUCE_SCALY)
    ]
    assert pale[0] > 2 * pale[1]


def test_twigs_are_cut_out_and_none_like_another(twigs):
    names = [*CROWN_FOLIAGE, Layer.BARE_TWIG]
    assert set(names) <= set(twigs)
    for name in names:
        alpha = twigs[name][..., 3]
        assert 0.05 < (alpha > 0.5).mean() < 0.7
        assert alpha[0].max() == alpha[-1].max() == alpha[:, -1].max() == 0
    masks = np.stack([twigs[name][..., 3] > 0.5 for name in names])
    for index, mask in enumerate(masks):
        others = np.delete(masks, index, 0)
        assert (others ^ mask).mean((1, 2)).min() > 0.05
