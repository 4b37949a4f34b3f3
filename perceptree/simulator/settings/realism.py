"""Settings of additions beyond the paper's conditions. By default all of them are off."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import Range, check_number, check_range

_OFF = (0.0, 0.0)


@dataclass(frozen=True)
class ClutterSettings:
    """Clutter beyond the undergrowth. Each scene draws from these ranges.

    Attributes:
        dead_twigs: Thin dead twigs on the lower stem of a near conifer, in hundreds.
        herbs: Cover of the ground by herbs, 0 (none) to 1 (no gap).
        shrubs: Cover of the ground by dwarf shrubs, 0 (none) to 1 (no gap).
        foot: Fraction of near stems with plants, branches or stones around their foot.
        backdrop: Density of the forest beyond the simulated stand, 0 to 1 (dense); 0 draws a
            plain silhouette.

    Raises:
        SettingsError: If a value is out of range.
    """

    dead_twigs: Range = _OFF
    herbs: Range = _OFF
    shrubs: Range = _OFF
    foot: Range = _OFF
    backdrop: Range = _OFF

    def __post_init__(self) -> None:
        check_range("dead_twigs", self.dead_twigs, 0.0, 5.0)
        for name in ("herbs", "shrubs", "foot", "backdrop"):
            check_range(name, getattr(self, name), 0.0, 1.0)


@dataclass(frozen=True)
class ObjectSettings:
    """Objects that are not trees. Each scene draws numbers of objects within 18 m, rounded.

    Attributes:
        people: People.
        animals: Animals.
        machines: Forest machines.
        posts: Poles, signs and fences.
        logs: Lying stems, log piles and heaps of branches.
        walls: Walls, huge boulders and huts.
        shapes: Solids of random shape and texture, which represent unknown objects.

    Raises:
        SettingsError: If a value is out of range.
    """

    people: Range = _OFF
    animals: Range = _OFF
    machines: Range = _OFF
    posts: Range = _OFF
    logs: Range = _OFF
    walls: Range = _OFF
    shapes: Range = _OFF

    def __post_init__(self) -> None:
        for name in ("people", "animals", "machines", "posts", "logs", "walls", "shapes"):
            check_range(name, getattr(self, name), 0.0, 50.0)


@dataclass(frozen=True)
class NegativeSettings:
    """What is mistaken for stems, near the cameras. Each view draws numbers, rounded.

    The objects stand before the cameras of the scene's independent views, from about the nearest
    ground in the picture to twice as far; drives have none of them. Views do not depend on it, nor
    do labels: what hides a stem lowers its visible fraction.

    Attributes:
        people: People, of whom legs or more are in the picture.
        animals: Animals.
        posts: Thin and thick posts of wood, metal and concrete.
        logs: Lying and leaning dead trunks, and dead limbs.
        stumps: Stumps of up to 0.9 m.
        twigs: Twigs at the lens that hang into the picture.
        thickets: Rows of bushes and young conifers with dark or bright gaps, for each scene.

    Raises:
        SettingsError: If a value is out of range.
    """

    people: Range = _OFF
    animals: Range = _OFF
    posts: Range = _OFF
    logs: Range = _OFF
    stumps: Range = _OFF
    twigs: Range = _OFF
    thickets: Range = _OFF

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            check_range(name, value, 0.0, 10.0)


@dataclass(frozen=True)
class ImagingSettings:
    """Faults of cameras and of their image processing, beyond noise and blur.

    Attributes:
        share: Fraction of frames with faults; each fault then occurs at random.
        strength: Range of the strength of the faults, 0 to 1 (worst).
        exposure_stops: Range of the exposure error of such frames, in stops.
        infrared_share: Fraction of such frames that are grey near-infrared pictures with bright
            leaves.
        saturation: Range of the saturation factor of all frames.

    Raises:
        SettingsError: If a value is out of range.
    """

    share: float = 0.0
    strength: Range = (0.0, 1.0)
    exposure_stops: Range = _OFF
    infrared_share: float = 0.0
    saturation: Range = (1.0, 1.0)

    def __post_init__(self) -> None:
        check_number("share", self.share, 0.0, 1.0)
        check_range("strength", self.strength, 0.0, 1.0)
        check_range("exposure_stops", self.exposure_stops, -4.0, 4.0)
        check_number("infrared_share", self.infrared_share, 0.0, 1.0)
        check_range("saturation", self.saturation, 0.0, 4.0)


@dataclass(frozen=True)
class RandomisationSettings:
    """Unnatural colours and textures (domain randomisation, Tobin et al. 2017), per scene.

    Attributes:
        recolour: Probability that the colour of a material is changed.
        swap: Probability that a material has the texture of another one.
        sky: Probability that the light has an unnatural colour.

    Raises:
        SettingsError: If a value is out of range.
    """

    recolour: float = 0.0
    swap: float = 0.0
    sky: float = 0.0

    def __post_init__(self) -> None:
        for name in ("recolour", "swap", "sky"):
            check_number(name, getattr(self, name), 0.0, 1.0)
