"""Which photograph a layer may show: by kind, and by words in the name."""

from __future__ import annotations

from perceptree.simulator.materials.layers import FIRST_GROUND, LAST_BARK, Layer, is_cutout
from perceptree.simulator.photographs.folder import FOLIAGE, PANORAMA, PhotoFolder, Photograph
from perceptree.simulator.settings import SPECIES

_SNOW = 0.25  # photographs of snow show where at least this much lies
_WORDS: tuple[tuple[tuple[str, ...], tuple[Layer, ...]], ...] = (
    (("dead", "stick", "bare"), (Layer.BARE_TWIG,)),
    (
        ("pine", "fir", "spruce", "larch", "cypress", "conifer", "needle"),
        (Layer.FIR_TWIG, Layer.SPRUCE_TWIG, Layer.PINE_TWIG),
    ),
    (("fern", "bracken"), (Layer.FERN,)),
    (("grass", "reed", "sedge"), (Layer.GRASS, Layer.DRY_GRASS)),
    (
        ("herb", "plant", "moss", "ivy", "bush", "shrub"),
        (Layer.HERB, Layer.BILBERRY, Layer.SCRUB),
    ),
)
_BROADLEAVED = (
    Layer.BEECH_LEAVES,
    Layer.BIRCH_LEAVES,
    Layer.MAPLE_LEAVES,
    Layer.SCRUB,
    Layer.BILBERRY,
)


def photographs_for(layer: Layer, folder: PhotoFolder, snow: float) -> list[Photograph]:
    """The photographs that a layer may show.

    Args:
        layer: The layer.
        folder: The photographs.
        snow: Amount of lying snow, 0 to 1.
    """
    if is_cutout(layer):
        return [photo for photo in folder.of_kind(FOLIAGE) if layer in _layers_of(photo)]
    if layer == Layer.ROCK:
        return _in_season(folder.of_kind("rock"), snow)
    if FIRST_GROUND <= layer <= Layer.MUD:
        return _in_season(folder.of_kind("ground"), snow)
    if layer <= LAST_BARK or layer == Layer.DEAD_WOOD:
        species = layer.name.split("_")[0].lower()
        return [
            photo
            for photo in _in_season(folder.of_kind("bark"), snow)
            if not (named := species_of(photo)) or species in named
        ]
    return []


def panoramas(folder: PhotoFolder, snow: float) -> list[Photograph]:
    """The panoramas that may be seen with an amount of lying snow: of snow, if there are any."""
    known = _in_season(folder.of_kind(PANORAMA), snow)
    return [photo for photo in known if _is_snow(photo)] or known if snow >= _SNOW else known


def species_of(photo: Photograph) -> list[str]:
    """The simulator's species that a photograph's name holds."""
    return [species for species in SPECIES if species in photo.name.lower()]


def _in_season(photographs: list[Photograph], snow: float) -> list[Photograph]:
    return [photo for photo in photographs if snow >= _SNOW or not _is_snow(photo)]


def _is_snow(photo: Photograph) -> bool:
    return "snow" in photo.name.lower()


def _layers_of(photo: Photograph) -> tuple[Layer, ...]:
    name = photo.name.lower()
    for words, layers in _WORDS:
        if any(word in name for word in words):
            return layers
    return _BROADLEAVED
