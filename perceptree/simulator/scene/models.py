"""The tree models: six species, each in three variants of bark and form."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.materials.layers import Layer

Span = tuple[float, float]


@dataclass(frozen=True)
class TreeModel:
    """A tree model: species, bark and shape parameters.

    Attributes:
        name: Name of the model.
        species: Its species, one of SPECIES.
        bark: Texture layer of the bark.
        conifer: Whether the tree is a conifer.
        bark_m: Length of bark that one repeat of the texture shows, m.
        height_m: Height that the thickest stems approach, m.
        taper: Exponent of the radius over the distance to the tip.
        flare: Range of the root collar's widening, as a fraction of the stem's radius.
        bumps: Standard deviation of the cross-section's irregularity, as a fraction of the radius.
        sweep_m: Size of the axis's bends, m.
        lean: Factor of the stand's lean.
        fork: Factor of the stand's fraction of forked stems.
        crown_base: Range of the height where the crown begins, as a fraction of the tree's height.
        dead_branches: Number of dead branches below the crown of a near tree.
    """

    name: str
    species: str
    bark: Layer
    conifer: bool
    bark_m: float
    height_m: float
    taper: float
    flare: Span
    bumps: float
    sweep_m: float
    lean: float
    fork: float
    crown_base: Span
    dead_branches: int


def _conifer(
    name: str,
    bark_m: float,
    height_m: float,
    flare: Span,
    bumps: float,
    sweep_m: float,
    lean: float,
    fork: float,
    crown_base: Span,
    dead_branches: int,
) -> TreeModel:
    return TreeModel(
        name,
        name.split("_")[0],
        Layer[name.upper()],
        True,
        bark_m,
        height_m,
        0.82,
        flare,
        bumps,
        sweep_m,
        lean,
        fork,
        crown_base,
        dead_branches,
    )


def _broadleaf(
    name: str,
    bark_m: float,
    height_m: float,
    flare: Span,
    bumps: float,
    sweep_m: float,
    lean: float,
    fork: float,
    crown_base: Span,
) -> TreeModel:
    return TreeModel(
        name,
        name.split("_")[0],
        Layer[name.upper()],
        False,
        bark_m,
        height_m,
        0.68,
        flare,
        bumps,
        sweep_m,
        lean,
        fork,
        crown_base,
        0,
    )


MODELS: tuple[TreeModel, ...] = (
    # name, bark_m, height_m, flare, bumps, sweep_m, lean, fork, crown_base, dead branches
    _conifer("fir_grey", 0.70, 25, (0.15, 0.35), 0.008, 0.05, 0.8, 0.5, (0.30, 0.48), 34),
    _conifer("fir_resin", 0.55, 22, (0.10, 0.28), 0.008, 0.04, 0.8, 0.4, (0.12, 0.30), 18),
    _conifer("fir_mossy", 0.70, 24, (0.25, 0.50), 0.012, 0.08, 1.1, 0.6, (0.25, 0.42), 40),
    _conifer("spruce_scaly", 0.50, 26, (0.25, 0.50), 0.010, 0.05, 0.9, 0.4, (0.28, 0.46), 44),
    _conifer("spruce_grey", 0.55, 24, (0.20, 0.45), 0.010, 0.06, 0.9, 0.4, (0.12, 0.30), 26),
    _conifer("spruce_lichen", 0.55, 23, (0.25, 0.55), 0.013, 0.09, 1.2, 0.5, (0.24, 0.42), 52),
    _conifer("pine_orange", 0.90, 23, (0.06, 0.18), 0.006, 0.10, 1.0, 0.7, (0.48, 0.66), 12),
    _conifer("pine_plated", 1.00, 24, (0.10, 0.25), 0.009, 0.12, 1.1, 0.8, (0.52, 0.70), 9),
    _conifer("pine_grey", 0.80, 19, (0.06, 0.20), 0.009, 0.18, 1.4, 1.2, (0.36, 0.54), 16),
    # name, bark_m, height_m, flare, bumps, sweep_m, lean, fork, crown_base
    _broadleaf("beech_smooth", 0.90, 25, (0.25, 0.55), 0.014, 0.10, 1.0, 1.6, (0.25, 0.42)),
    _broadleaf("beech_lichen", 0.90, 24, (0.30, 0.60), 0.017, 0.14, 1.1, 1.8, (0.22, 0.38)),
    _broadleaf("beech_mossy", 0.80, 22, (0.35, 0.75), 0.020, 0.18, 1.3, 2.0, (0.16, 0.32)),
    _broadleaf("birch_white", 0.70, 21, (0.08, 0.25), 0.008, 0.14, 1.4, 1.2, (0.30, 0.50)),
    _broadleaf("birch_dark", 0.70, 22, (0.15, 0.40), 0.014, 0.16, 1.4, 1.4, (0.32, 0.50)),
    _broadleaf("birch_mossy", 0.65, 19, (0.15, 0.40), 0.012, 0.22, 1.7, 1.6, (0.24, 0.42)),
    _broadleaf("maple_furrowed", 0.60, 22, (0.25, 0.50), 0.018, 0.12, 1.0, 1.6, (0.22, 0.38)),
    _broadleaf("maple_grey", 0.70, 21, (0.20, 0.45), 0.015, 0.12, 1.1, 1.8, (0.20, 0.36)),
    _broadleaf("maple_mossy", 0.60, 20, (0.30, 0.65), 0.022, 0.18, 1.3, 2.0, (0.16, 0.32)),
)
