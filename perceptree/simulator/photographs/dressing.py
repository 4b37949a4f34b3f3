"""Photographs in a scene: layers of its own, and a far stand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from basetree.arrays import Float, UInt8
from perceptree.simulator.materials.layers import FIRST_GROUND, SIZE_PX, Layer, is_cutout
from perceptree.simulator.materials.textures import Textures, layer_texels, pack_layer
from perceptree.simulator.photographs.choice import panoramas, photographs_for
from perceptree.simulator.photographs.folder import PhotoFolder, Photograph
from perceptree.simulator.photographs.loading import load_cutout, load_material
from perceptree.simulator.photographs.panoramas import load_panorama
from perceptree.simulator.photographs.variants import foliage_layer, material_layer
from perceptree.simulator.rendering.kernel_types import FarStand
from perceptree.simulator.scene.description import Scene
from perceptree.simulator.settings import PhotographSettings
from perceptree.simulator.streams import Stream, stream

_FAR_STAND = 1000  # number of the far stand among the layers' streams
_SHRINK = (5, 7)  # least and largest factor by which a far stand is made smaller
_BARE_SHARE = 0.5  # far stands without the procedural forest in front
_BRIGHT = 97  # percentile of the upper third's luminance that is taken for bright sky
_MIDDLE_LEVEL = 3  # mip level at which mean colours are taken


@dataclass(frozen=True)
class Dressing:
    """What photographs change in a scene.

    Attributes:
        textures: Textures of all layers; the outlines of cut-outs are those of the procedural ones.
        far_stand: Photographed far stand; None for the procedural one.
        far_forest: Whether the procedural forest stands in front of it.
    """

    textures: Textures
    far_stand: FarStand | None
    far_forest: bool


def dress(
    scene: Scene,
    layers: UInt8,
    textures: Textures,
    folder: PhotoFolder,
    settings: PhotographSettings,
) -> Dressing:
    """Choose photographs for a scene, and draw its layers from them.

    Args:
        scene: The scene.
        layers: Layers of its faces.
        textures: Procedural textures.
        folder: The photographs.
        settings: Share of the layers that show photographs.

    Raises:
        SettingsError: If a photograph cannot be used.
    """
    albedo, normals = textures.albedo.copy(), textures.normals.copy()
    own = Textures(albedo, textures.alpha, normals, textures.offsets)
    for layer in _shown(scene, layers):
        rng = stream(scene.seed, Stream.PHOTOGRAPHS, layer)
        candidates = photographs_for(layer, folder, scene.weather.snow)
        if candidates and rng.random() < settings.share:
            photo = candidates[rng.integers(len(candidates))]
            _show(rng, photo, layer, own, mean_colour(textures, layer))
    rng = stream(scene.seed, Stream.PHOTOGRAPHS, _FAR_STAND)
    candidates = panoramas(folder, scene.weather.snow)
    if not candidates or rng.random() >= settings.share:
        return Dressing(own, None, True)
    photo = candidates[rng.integers(len(candidates))]
    return Dressing(own, _far_stand(rng, photo), bool(rng.random() >= _BARE_SHARE))


def _shown(scene: Scene, layers: UInt8) -> list[Layer]:
    """The layers whose textures are seen in a scene."""
    ground = [FIRST_GROUND + k for k in np.flatnonzero(scene.terrain.cover > 0)]
    seen = np.unique(np.concatenate([np.unique(layers).astype(int), np.array(ground, int)]))
    return [Layer(number) for number in np.unique(scene.appearance.texture_layer[seen])]


def mean_colour(textures: Textures, layer: Layer) -> Float:
    """(3,) mean linear RGB of a layer where it is opaque."""
    texels = textures.albedo[layer_texels(textures, layer, _MIDDLE_LEVEL)].astype(float) / 255
    weight = texels[:, 3:]
    return np.asarray((texels[:, :3] ** 2 * weight).sum(0) / max(float(weight.sum()), 1e-6))


def _show(
    rng: np.random.Generator, photo: Photograph, layer: Layer, textures: Textures, mean: Float
) -> None:
    if is_cutout(layer):
        colour, grey = load_cutout(photo)
        flat = np.full((SIZE_PX, SIZE_PX, 3), (0.5, 0.5, 1.0), np.float32)
        pack_layer(textures, layer, foliage_layer(rng, colour, grey, mean), flat)
        return
    ground = FIRST_GROUND <= layer <= Layer.MUD
    upright = not ground and layer != Layer.ROCK
    made = material_layer(rng, load_material(photo), mean, upright, mossy=not ground)
    pack_layer(textures, layer, *made)


def _far_stand(rng: np.random.Generator, photo: Photograph) -> FarStand:
    colour, _ = load_panorama(photo)
    linear = (np.arange(256) / 255) ** 2.2
    root = (np.sqrt(linear) * 255 + 0.5).astype(np.uint8)
    upper = linear[colour[: len(colour) // 3 : 2, ::2]] @ np.array([0.3, 0.6, 0.1])
    bright = max(float(np.percentile(upper, _BRIGHT)), 1e-3)
    shrink, turn = rng.integers(_SHRINK[0], _SHRINK[1] + 1), rng.random()
    return FarStand(root[colour], np.array([shrink, turn, 1 / bright], np.float32))
