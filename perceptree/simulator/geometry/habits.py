"""Crown parameters of each species (the habit of a tree is its characteristic shape)."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.materials.layers import Layer


@dataclass(frozen=True)
class Habit:
    """Crown parameters of a species, for a tree of 16 m height.

    Attributes:
        foliage: Texture layer of the twigs.
        wood: Texture layer of the branches.
        branches: Number of branches.
        reach_m: Length of the longest branches, m.
        widest: Position of the longest branches, as a fraction of the crown's height.
        pointed: Exponent by which branches get shorter towards the top.
        irregular: Standard deviation of the logarithm of the branch length.
        rise: Slope of the branches at the crown's base and top.
        droop: Downward bend of the branches.
        lift: Upward bend of their tips.
        forks: Side branches per branch.
        wood_m: Radius of a branch of 1 m length, m.
        twigs: Twigs per branch.
        bare: Fraction of a branch's length, from its base, without twigs.
        twig_m: Length of twigs at the base and at the tip of a branch, m.
        ratio: Width over length of a twig.
        fan_rad: Angle between twig and branch.
        hang: Slope of twigs.
        roll_rad: Standard deviation of the rotation of twigs about their axis.
        fold: Height of a twig's fold over half its width.
    """

    foliage: Layer
    wood: Layer
    branches: int
    reach_m: float
    widest: float
    pointed: float
    irregular: float
    rise: tuple[float, float]
    droop: float
    lift: float
    forks: int
    wood_m: float
    twigs: int
    bare: float
    twig_m: tuple[float, float]
    ratio: float
    fan_rad: float
    hang: float
    roll_rad: float
    fold: float


HABITS: dict[str, Habit] = {
    "fir": Habit(
        Layer.FIR_TWIG,
        Layer.FIR_GREY,
        branches=64,
        reach_m=2.5,
        widest=0.10,
        pointed=0.85,
        irregular=0.14,
        rise=(-0.05, 0.45),
        droop=0.16,
        lift=0.10,
        forks=0,
        wood_m=0.013,
        twigs=10,
        bare=0.10,
        twig_m=(0.92, 0.52),
        ratio=0.66,
        fan_rad=0.80,
        hang=-0.14,
        roll_rad=0.38,
        fold=0.45,
    ),
    "spruce": Habit(
        Layer.SPRUCE_TWIG,
        Layer.SPRUCE_GREY,
        branches=64,
        reach_m=2.6,
        widest=0.06,
        pointed=0.95,
        irregular=0.20,
        rise=(-0.20, 0.60),
        droop=0.50,
        lift=0.32,
        forks=0,
        wood_m=0.013,
        twigs=10,
        bare=0.08,
        twig_m=(0.80, 0.58),
        ratio=0.70,
        fan_rad=0.90,
        hang=-0.50,
        roll_rad=0.70,
        fold=0.55,
    ),
    "pine": Habit(
        Layer.PINE_TWIG,
        Layer.PINE_ORANGE,
        branches=30,
        reach_m=2.9,
        widest=0.38,
        pointed=0.50,
        irregular=0.34,
        rise=(0.10, 0.85),
        droop=0.05,
        lift=0.25,
        forks=2,
        wood_m=0.019,
        twigs=7,
        bare=0.45,
        twig_m=(0.75, 0.80),
        ratio=0.85,
        fan_rad=0.90,
        hang=0.25,
        roll_rad=1.20,
        fold=0.25,
    ),
    "beech": Habit(
        Layer.BEECH_LEAVES,
        Layer.BEECH_SMOOTH,
        branches=30,
        reach_m=4.0,
        widest=0.35,
        pointed=0.50,
        irregular=0.16,
        rise=(0.35, 1.30),
        droop=0.30,
        lift=0.0,
        forks=3,
        wood_m=0.017,
        twigs=8,
        bare=0.22,
        twig_m=(0.95, 0.85),
        ratio=0.75,
        fan_rad=0.80,
        hang=-0.06,
        roll_rad=0.50,
        fold=0.24,
    ),
    "birch": Habit(
        Layer.BIRCH_LEAVES,
        Layer.BIRCH_DARK,
        branches=34,
        reach_m=3.2,
        widest=0.40,
        pointed=0.55,
        irregular=0.24,
        rise=(0.80, 1.60),
        droop=0.75,
        lift=-0.15,
        forks=2,
        wood_m=0.012,
        twigs=8,
        bare=0.35,
        twig_m=(0.85, 1.05),
        ratio=0.50,
        fan_rad=0.75,
        hang=-1.30,
        roll_rad=0.90,
        fold=0.20,
    ),
    "maple": Habit(
        Layer.MAPLE_LEAVES,
        Layer.MAPLE_GREY,
        branches=28,
        reach_m=3.6,
        widest=0.45,
        pointed=0.45,
        irregular=0.18,
        rise=(0.50, 1.40),
        droop=0.22,
        lift=0.10,
        forks=3,
        wood_m=0.019,
        twigs=8,
        bare=0.30,
        twig_m=(0.95, 0.90),
        ratio=0.85,
        fan_rad=1.00,
        hang=-0.30,
        roll_rad=0.95,
        fold=0.30,
    ),
}
