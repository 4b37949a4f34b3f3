"""Crown parameters of each species (the habit of a tree is its characteristic shape).

They are in `habits.json`, with those of dead twigs and branches.
"""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.rows import read_rows


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


HABITS = {
    name: Habit(**row) for name, row in read_rows("geometry/habits.json", Layer.__members__).items()
}
