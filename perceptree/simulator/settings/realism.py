"""Settings of what real pictures hold beyond the paper's: off unless a mix asks for it."""

from __future__ import annotations

from dataclasses import dataclass

from perceptree.simulator.settings.checks import Range, check_number, check_range

_OFF = (0.0, 0.0)


@dataclass(frozen=True)
class ClutterSettings:
    """What grows at and around stems beyond the undergrowth. Each scene draws from these ranges.

    ``dead_twigs`` is the number of thin dry twigs on the lower stem of a near conifer, in
    hundreds; ``herbs`` and ``shrubs`` close the ground from 0 (none) to 1 (no gap); ``foot``
    is the share of near stems with plants, twigs or stones about their foot. ``backdrop`` is how
    many trunks and crowns stand beyond the simulated stand, 1 for a dense one; where it is drawn
    as 0, the far forest is a plain wall.
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
    """Things that are no trees. Each scene draws how many stand or lie within 18 m, rounded.

    ``posts`` are poles, signs and fences; ``logs`` lying stems, log piles and their ends;
    ``shapes`` solids of random form and texture that stand for whatever else there may be.
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
class ImagingSettings:
    """Faults of cameras and their processing, beyond noise and blur.

    ``share`` of the frames have them; such a frame draws from ``strength``, 1 being the worst,
    and each fault appears by chance. ``exposure_stops`` is how far such a frame's exposure is off.
    ``infrared_share`` of them are grey pictures in near-infrared, where leaves are bright. The
    colours of every frame, faulty or not, are ``saturation`` times as strong as light has them.
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
    """Colours and textures from far outside the natural, drawn anew in each scene.

    By a chance of ``recolour`` a material's colour is changed, by ``swap`` it wears another
    material's texture, by ``sky`` the light has any colour.
    """

    recolour: float = 0.0
    swap: float = 0.0
    sky: float = 0.0

    def __post_init__(self) -> None:
        for name in ("recolour", "swap", "sky"):
            check_number(name, getattr(self, name), 0.0, 1.0)
