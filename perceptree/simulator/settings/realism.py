"""Settings of additions beyond the paper's conditions. By default all of them are off."""

from __future__ import annotations

from dataclasses import dataclass, field

from basetree.settings import Settings
from perceptree.simulator.settings.checks import Range, number

_OFF = (0.0, 0.0)


@dataclass(frozen=True)
class ClutterSettings(Settings, each=number(0, 1)):
    """Clutter beyond the undergrowth. Each scene draws from these ranges."""

    dead_twigs: Range = field(default=_OFF, metadata=number(0, 5))
    """Thin dead twigs on the lower stem of a near conifer, in hundreds."""
    herbs: Range = _OFF
    """Cover of the ground by herbs, 0 (none) to 1 (no gap)."""
    shrubs: Range = _OFF
    """Cover of the ground by dwarf shrubs, 0 (none) to 1 (no gap)."""
    foot: Range = _OFF
    """Fraction of near stems with plants, branches or stones around their foot."""
    backdrop: Range = _OFF
    """Density of the forest beyond the simulated stand, 0 to 1 (dense); 0 draws a plain
    silhouette."""


@dataclass(frozen=True)
class ObjectSettings(Settings, each=number(0, 50)):
    """Objects that are not trees. Each scene draws numbers of objects within 18 m, rounded."""

    people: Range = _OFF
    """People."""
    animals: Range = _OFF
    """Animals."""
    machines: Range = _OFF
    """Forest machines."""
    posts: Range = _OFF
    """Poles, signs and fences."""
    logs: Range = _OFF
    """Lying stems, log piles and heaps of branches."""
    walls: Range = _OFF
    """Walls, huge boulders and huts."""
    shapes: Range = _OFF
    """Solids of random shape and texture, which represent unknown objects."""


@dataclass(frozen=True)
class NegativeSettings(Settings, each=number(0, 10)):
    """What is mistaken for stems, near the cameras. Each view draws numbers, rounded.

    The objects stand before the cameras of the scene's independent views, from about the nearest
    ground in the picture to twice as far; drives have none of them. Views do not depend on it, nor
    do labels: what hides a stem lowers its visible fraction.
    """

    people: Range = _OFF
    """People, of whom legs or more are in the picture."""
    animals: Range = _OFF
    """Animals."""
    posts: Range = _OFF
    """Thin and thick posts of wood, metal and concrete."""
    logs: Range = _OFF
    """Lying and leaning dead trunks, and dead limbs."""
    stumps: Range = _OFF
    """Stumps of up to 0.9 m."""
    twigs: Range = _OFF
    """Twigs at the lens that hang into the picture."""
    thickets: Range = _OFF
    """Rows of bushes and young conifers with dark or bright gaps, for each scene."""


@dataclass(frozen=True)
class ImagingSettings(Settings):
    """Faults of cameras and of their image processing, beyond noise and blur."""

    share: float = field(default=0.0, metadata=number(0, 1))
    """Fraction of frames with faults; each fault then occurs at random."""
    strength: Range = field(default=(0.0, 1.0), metadata=number(0, 1))
    """Range of the strength of the faults, 0 to 1 (worst)."""
    exposure_stops: Range = field(default=_OFF, metadata=number(-4, 4))
    """Range of the exposure error of such frames, in stops."""
    infrared_share: float = field(default=0.0, metadata=number(0, 1))
    """Fraction of such frames that are grey near-infrared pictures with bright leaves."""
    saturation: Range = field(default=(1.0, 1.0), metadata=number(0, 4))
    """Range of the saturation factor of all frames."""


@dataclass(frozen=True)
class RandomisationSettings(Settings, each=number(0, 1)):
    """Unnatural colours and textures (domain randomisation, Tobin et al. 2017), per scene."""

    recolour: float = 0.0
    """Probability that the colour of a material is changed."""
    swap: float = 0.0
    """Probability that a material has the texture of another one."""
    sky: float = 0.0
    """Probability that the light has an unnatural colour."""
