"""Stems as meshes, whose corners lie on the formulas that the labels come from."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from perceptree.simulator.geometry.mesh import Mesh, merge, surface_mesh
from perceptree.simulator.scene.stem import Stem

Float = NDArray[np.floating[Any]]

STEM_SIDES = 48
_UPPER_SIDES = 16
_FAR_SIDES = 7
_FOOT_M = -0.6


def stem_mesh(stem: Stem, label_heights_m: tuple[float, ...], near: bool) -> Mesh:
    """The stem's bark with its fork; near stems have a ring at every height of the labels.

    The faces of both leaders below the last of ``label_heights_m`` are labelled.
    """
    if not near:
        levels = _FOOT_M + (stem.height_m - _FOOT_M) * np.linspace(0, 1, 6) ** 1.5
        return merge([_bark(stem, levels, _FAR_SIDES, False), *_fork(stem, (), 5, _FAR_SIDES)])
    lower = lower_levels_m(stem, label_heights_m)
    upper = lower[-1] + (stem.height_m - lower[-1]) * np.linspace(0, 1, 9)
    parts = [_bark(stem, lower, STEM_SIDES, True), _bark(stem, upper, _UPPER_SIDES, False)]
    return merge(parts + _fork(stem, label_heights_m[-1:], 10, 20))


def lower_levels_m(stem: Stem, label_heights_m: tuple[float, ...]) -> Float:
    """Heights above the foot of a near stem's rings, up to the last of ``label_heights_m``."""
    top_m = min(label_heights_m[-1], 0.98 * stem.height_m)
    levels = _FOOT_M + (top_m - _FOOT_M) * np.linspace(0, 1, 21) ** 1.6
    return np.unique([*levels, *(height for height in label_heights_m if height <= top_m)])


def _bark(stem: Stem, height_m: Float, sides: int, labelled: bool) -> Mesh:
    mesh = _scaled(stem, stem.rings(height_m, sides), stem.axis(height_m))
    return replace(mesh, labelled=np.full(len(mesh.faces), labelled))


def _fork(stem: Stem, rings_at_m: tuple[float, ...], rings: int, sides: int) -> list[Mesh]:
    """The second leader, if there is one; below ``rings_at_m`` it is labelled."""
    fork = stem.fork
    if fork is None:
        return []
    levels = fork.height_m + (fork.top_m - fork.height_m) * np.linspace(0, 1, rings) ** 1.5
    inside = [height for height in rings_at_m if fork.height_m < height < fork.top_m]
    levels = np.unique([*levels, *inside])
    mesh = _scaled(stem, stem.fork_rings(levels, sides), stem.fork_axis(levels))
    below = int(np.searchsorted(levels, inside[-1])) if inside else 0
    return [replace(mesh, labelled=np.arange(len(mesh.faces)) < below * sides * 2)]


def _scaled(stem: Stem, rings: Float, axis: Float) -> Mesh:
    """Rings as a surface whose bark keeps its size on thick and thin stems.

    A stem too thin for one repeat around it shows the bark finer, as young bark is. The stem's
    own phases shift the bark, so that neighbours do not repeat each other.
    """
    girth_m, bark_m = np.pi * stem.diameter_m, stem.model.bark_m
    repeats = max(1, round(girth_m / bark_m))
    mesh = surface_mesh(
        rings[None], axis[None], stem.model.bark, repeats, np.sqrt(bark_m * girth_m / repeats), 1.0
    )
    return replace(mesh, uv=mesh.uv + stem.sweep_phase / (2 * np.pi))
