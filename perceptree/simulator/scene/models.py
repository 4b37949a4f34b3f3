"""The tree models: six species, each in three variants of bark and form."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.materials.layers import Layer

Span = tuple[float, float]

_CONIFERS = ("fir", "spruce", "pine")


@dataclass(frozen=True)
class TreeModel:
    """A tree model: species, bark and shape parameters.

    Attributes:
        name: Name of the model.
        bark_m: Length of bark that one repeat of the texture shows, m.
        height_m: Height that the thickest stems approach, m.
        flare: Range of the root collar's widening, as a fraction of the stem's radius.
        bumps: Standard deviation of the cross-section's irregularity, as a fraction of the radius.
        sweep_m: Size of the axis's bends, m.
        lean: Factor of the stand's lean.
        fork: Factor of the stand's fraction of forked stems.
        crown_base: Range of the height where the crown begins, as a fraction of the tree's height.
        dead_branches: Number of dead branches below the crown of a near tree.
    """

    name: str
    bark_m: float
    height_m: float
    flare: Span
    bumps: float
    sweep_m: float
    lean: float
    fork: float
    crown_base: Span
    dead_branches: int = 0

    @property
    def species(self) -> str:
        """Its species, one of SPECIES."""
        return self.name.split("_")[0]

    @property
    def bark(self) -> Layer:
        """Texture layer of the bark."""
        return Layer[self.name.upper()]

    @property
    def conifer(self) -> bool:
        """Whether the tree is a conifer."""
        return self.species in _CONIFERS

    @property
    def taper(self) -> float:
        """Exponent of the radius over the distance to the tip."""
        return 0.82 if self.conifer else 0.68


MODELS: tuple[TreeModel, ...] = (
    # name, bark_m, height_m, flare, bumps, sweep_m, lean, fork, crown_base, dead branches
    TreeModel("fir_grey", 0.70, 25, (0.15, 0.35), 0.008, 0.05, 0.8, 0.5, (0.30, 0.48), 34),
    TreeModel("fir_resin", 0.55, 22, (0.10, 0.28), 0.008, 0.04, 0.8, 0.4, (0.12, 0.30), 18),
    TreeModel("fir_mossy", 0.70, 24, (0.25, 0.50), 0.012, 0.08, 1.1, 0.6, (0.25, 0.42), 40),
    TreeModel("spruce_scaly", 0.50, 26, (0.25, 0.50), 0.010, 0.05, 0.9, 0.4, (0.28, 0.46), 44),
    TreeModel("spruce_grey", 0.55, 24, (0.20, 0.45), 0.010, 0.06, 0.9, 0.4, (0.12, 0.30), 26),
    TreeModel("spruce_lichen", 0.55, 23, (0.25, 0.55), 0.013, 0.09, 1.2, 0.5, (0.24, 0.42), 52),
    TreeModel("pine_orange", 0.90, 23, (0.06, 0.18), 0.006, 0.10, 1.0, 0.7, (0.48, 0.66), 12),
    TreeModel("pine_plated", 1.00, 24, (0.10, 0.25), 0.009, 0.12, 1.1, 0.8, (0.52, 0.70), 9),
    TreeModel("pine_grey", 0.80, 19, (0.06, 0.20), 0.009, 0.18, 1.4, 1.2, (0.36, 0.54), 16),
    TreeModel("beech_smooth", 0.90, 25, (0.25, 0.55), 0.014, 0.10, 1.0, 1.6, (0.25, 0.42)),
    TreeModel("beech_lichen", 0.90, 24, (0.30, 0.60), 0.017, 0.14, 1.1, 1.8, (0.22, 0.38)),
    TreeModel("beech_mossy", 0.80, 22, (0.35, 0.75), 0.020, 0.18, 1.3, 2.0, (0.16, 0.32)),
    TreeModel("birch_white", 0.70, 21, (0.08, 0.25), 0.008, 0.14, 1.4, 1.2, (0.30, 0.50)),
    TreeModel("birch_dark", 0.70, 22, (0.15, 0.40), 0.014, 0.16, 1.4, 1.4, (0.32, 0.50)),
    TreeModel("birch_mossy", 0.65, 19, (0.15, 0.40), 0.012, 0.22, 1.7, 1.6, (0.24, 0.42)),
    TreeModel("maple_furrowed", 0.60, 22, (0.25, 0.50), 0.018, 0.12, 1.0, 1.6, (0.22, 0.38)),
    TreeModel("maple_grey", 0.70, 21, (0.20, 0.45), 0.015, 0.12, 1.1, 1.8, (0.20, 0.36)),
    TreeModel("maple_mossy", 0.60, 20, (0.30, 0.65), 0.022, 0.18, 1.3, 2.0, (0.16, 0.32)),
)
