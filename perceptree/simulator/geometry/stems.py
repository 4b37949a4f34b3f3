"""Stem meshes. Their vertices are on the analytic surface that the labels are computed from."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from basetree.arrays import Float
from perceptree.simulator.geometry.mesh import Mesh, merge, surface_mesh
from perceptree.simulator.materials.layers import Layer
from perceptree.simulator.scene.stem import Stem
from perceptree.simulator.vectors import UP

STEM_SIDES = 48
_UPPER_SIDES = 16
_FAR_SIDES = 7
_FOOT_M = -0.6  # stems start this far below their foot, for slopes
_SPLINTER_RATIO = 0.5  # height of the splinters over the stem's diameter


def stem_mesh(stem: Stem, label_heights_m: tuple[float, ...], near: bool) -> Mesh:
    """Make the mesh of a stem with its fork.

    Args:
        stem: The stem.
        label_heights_m: Heights of the labels above the foot, ascending, m. A near stem has a
            ring at each of them, and its faces below the last one are labelled.
        near: Whether to make full detail.
    """
    if not near:
        levels = _FOOT_M + (_end_m(stem) - _FOOT_M) * np.linspace(0, 1, 6) ** 1.5
        return merge([_bark(stem, levels, _FAR_SIDES, False), *_fork(stem, (), 5, _FAR_SIDES)])
    lower = lower_levels_m(stem, label_heights_m)
    upper = lower[-1] + (_end_m(stem) - lower[-1]) * np.linspace(0, 1, 9)
    parts = [_bark(stem, lower, STEM_SIDES, True), _bark(stem, upper, _UPPER_SIDES, False)]
    if stem.broken_m is not None:
        parts.append(_splinters(stem, stem.broken_m))
    return merge(parts + _fork(stem, label_heights_m[-1:], 10, 20))


def lower_levels_m(stem: Stem, label_heights_m: tuple[float, ...]) -> Float:
    """Heights above the foot of a near stem's rings up to the last label height, m."""
    top_m = min(label_heights_m[-1], 0.98 * stem.height_m)
    levels = _FOOT_M + (top_m - _FOOT_M) * np.linspace(0, 1, 21) ** 1.6
    return np.unique([*levels, *(height for height in label_heights_m if height <= top_m)])


def _bark(stem: Stem, height_m: Float, sides: int, labelled: bool) -> Mesh:
    mesh = _scaled(stem, stem.rings(height_m, sides), stem.axis(height_m))
    return replace(mesh, labelled=np.full(len(mesh.faces), labelled))


def _end_m(stem: Stem) -> float:
    return stem.height_m if stem.broken_m is None else stem.broken_m


def _splinters(stem: Stem, height_m: float) -> Mesh:
    """The torn wood of a broken stem: a rim of splinters of unequal height."""
    rim = stem.rings(np.array([height_m]), _UPPER_SIDES)[0]
    turn = np.linspace(0, 2 * np.pi, _UPPER_SIDES + 1)
    torn = 1 + np.sin(turn + stem.sweep_phase[0]) + 0.6 * np.sin(7 * turn + stem.sweep_phase[1])
    tips = rim + UP * (_SPLINTER_RATIO * stem.diameter_m * np.maximum(torn, 0))[:, None]
    middle = stem.axis(np.array([height_m]))[0]
    inner = middle + 0.2 * (rim - middle)
    rings = np.stack([rim, middle + 0.97 * (tips - middle), inner])
    return surface_mesh(rings[None], rings.mean(1)[None], Layer.CUT_WOOD, 1, 0.3, 0.8)


def _fork(stem: Stem, rings_at_m: tuple[float, ...], rings: int, sides: int) -> list[Mesh]:
    """The second leader, if there is one; its faces below `rings_at_m` are labelled."""
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
    """Make a surface from rings, with the bark texture at its natural size.

    Stems too thin for one repeat of the texture have finer bark, like young trees. The texture is
    shifted by a random amount, so that neighbouring stems look different.
    """
    girth_m, bark_m = np.pi * stem.diameter_m, stem.model.bark_m
    repeats = max(1, round(girth_m / bark_m))
    mesh = surface_mesh(
        rings[None], axis[None], stem.model.bark, repeats, np.sqrt(bark_m * girth_m / repeats), 1.0
    )
    return replace(mesh, uv=mesh.uv + stem.sweep_phase / (2 * np.pi))
