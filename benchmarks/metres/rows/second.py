"""Masks that hold more than one stem: behind, beside or across, and forks; single ones too."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np

from basetree.arrays import Bool
from benchmarks.metres.caster import Cone
from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.sensors import mean_filtered, stereo_noise
from benchmarks.metres.stand import Stand, Stem


def _beside(
    rng: np.random.Generator, meant: Stem, further: float, apart: float, **changes: Any
) -> Stem:
    """A second stem, `further` times as far away and `apart` diameters beside the first."""
    apart_m = apart * meant.diameter_m * rng.choice([-1, 1])
    values = {
        "ahead_m": meant.ahead_m * further,
        "right_m": (meant.right_m + apart_m) * further,
        "diameter_m": meant.diameter_m * rng.uniform(0.6, 1.5),
        "lean_deg": abs(rng.normal(0, 2)),
        "measured": False,
    }
    return stem(rng, **{**values, **changes})


def _measured(rng: np.random.Generator, frame: Stand, mask: Bool, keypoints: bool) -> Readings:
    """The first stem with this mask, given or by a network."""
    frame.depth_m = stereo_noise(frame.depth_m, rng, rng.uniform(0.0005, 0.002))
    trees = frame.detections(rng, keypoints=keypoints, masks=[mask])
    return frame.readings(trees, masks=[mask], given_masks=[mask] if rng.random() < 0.5 else None)


def _two(
    further: tuple[float, float],
    apart: tuple[float, float],
    *,
    keypoints: bool = False,
    **changes: tuple[float, float],
) -> Callable[[np.random.Generator], Readings]:
    """A row of two stems in one mask; all arguments are ranges."""

    def draw(rng: np.random.Generator) -> Readings:
        meant = stem(rng, lean_deg=abs(rng.normal(0, 2)))
        drawn = {name: rng.uniform(*limits) for name, limits in changes.items()}
        second = _beside(rng, meant, rng.uniform(*further), rng.uniform(*apart), **drawn)
        frame = stand(rng, [meant, second])
        return _measured(rng, frame, frame.owner > 0, keypoints)

    return draw


def beside(rng: np.random.Generator) -> Readings:
    """Two stems as far away that touch, or stand apart by up to 0.4 of their mean diameter."""
    meant = stem(rng, lean_deg=abs(rng.normal(0, 2)))
    diameter_m = rng.uniform(0.15, 0.4)
    mean_m = (meant.diameter_m + diameter_m) / 2
    apart = rng.uniform(1.0, 1.4) * mean_m / meant.diameter_m
    second = _beside(rng, meant, rng.uniform(0.98, 1.02), apart, diameter_m=diameter_m)
    frame = stand(rng, [meant, second])
    return _measured(rng, frame, frame.owner > 0, False)


def _arm(rng: np.random.Generator, frame: Stand, from_m: float, bent: bool) -> list[Cone]:
    """A second stem that parts from the first one; a bent one turns upright in three pieces."""
    start_m = frame.to_camera.T @ frame.axis_m(0, from_m)
    tilt, towards = np.radians(rng.uniform(10, 35 if bent else 25)), rng.uniform(0, 2 * np.pi)
    radius_m = frame.stems[0].diameter_m / 2 * rng.uniform(0.5, 0.95)
    pieces = []
    for share in (1.0, 0.5, 0.1) if bent else (1.0,):
        lean = tilt * share
        along = np.array(
            [np.sin(lean) * np.cos(towards), -np.cos(lean), np.sin(lean) * np.sin(towards)]
        )
        length_m = 0.7 if bent and share > 0.1 else rng.uniform(2, 5)
        pieces.append(Cone(start_m, along, length_m, radius_m, 0.004, owner=1))
        start_m, radius_m = start_m + length_m * along, radius_m - 0.004 * length_m
    return pieces


def _fork(*, keypoints: bool, bent: bool = False) -> Callable[[np.random.Generator], Readings]:
    def draw(rng: np.random.Generator) -> Readings:
        frame = stand(rng, [stem(rng)])
        frame.things = _arm(rng, frame, rng.uniform(0.3, 2.0), bent)
        frame.render()
        return _measured(rng, frame, frame.owner == 1, keypoints)

    return draw


def branch(rng: np.random.Generator) -> Readings:
    """A branch or a stub in the mask."""
    frame = stand(rng, [stem(rng)])
    start_m = frame.to_camera.T @ frame.axis_m(0, rng.uniform(0.5, 2.5))
    tilt, towards = np.radians(rng.uniform(40, 90)), rng.uniform(0, 2 * np.pi)
    along = np.array(
        [np.sin(tilt) * np.cos(towards), -np.cos(tilt), np.sin(tilt) * np.sin(towards)]
    )
    radius_m = frame.stems[0].diameter_m / 2 * rng.uniform(0.2, 0.6)
    frame.things = [Cone(start_m, along, rng.uniform(0.2, 1.5), radius_m, 0.004, owner=1)]
    frame.render()
    return _measured(rng, frame, frame.owner == 1, False)


def single_oval(rng: np.random.Generator) -> Readings:
    """One oval stem, whose front is nearer on one side."""
    oval = {"oval": rng.uniform(1.0, 1.4), "oval_turn_deg": rng.uniform(0, 180)}
    frame = stand(rng, [stem(rng, **oval)])
    return _measured(rng, frame, frame.owner == 1, False)


def single_crude(rng: np.random.Generator) -> Readings:
    """One stem with a mask that is up to 6 px too wide or too narrow, or lies beside it."""
    frame = stand(rng, [stem(rng)])
    size_px = int(rng.integers(1, 7))
    mask = (frame.owner == 1).astype(np.uint8)
    change = (cv2.dilate, cv2.erode)[rng.integers(2)]
    mask = change(mask, np.ones((2 * size_px + 1, 2 * size_px + 1), np.uint8))
    mask = mask if mask.any() else (frame.owner == 1).astype(np.uint8)
    moved = np.roll(mask, int(rng.integers(-4, 5)), 1) if rng.random() < 0.5 else mask
    return _measured(rng, frame, moved > 0, False)


def single_smoothed(rng: np.random.Generator) -> Readings:
    """One stem in depth that a camera smooths, with holes."""
    frame = stand(rng, [stem(rng)])
    mask = frame.owner == 1
    frame.depth_m = mean_filtered(frame.depth_m, int(rng.choice([3, 5, 7])))
    holes = cv2.resize(rng.random((40, 60)), mask.shape[::-1]) < rng.uniform(0, 0.4)
    frame.depth_m = np.where(holes, 0, frame.depth_m).astype(np.float32)
    return _measured(rng, frame, mask, False)


def single_twigs(rng: np.random.Generator) -> Readings:
    """One stem with twigs across it and in its mask."""
    tree = stem(rng)
    frame = stand(rng, [tree])
    for _ in range(rng.integers(2, 30)):
        share = rng.uniform(0.7, 0.98)
        middle = np.array(
            [
                tree.right_m * share + rng.normal(0, 0.2),
                frame.camera_height_m - rng.uniform(0.2, 3),
                tree.ahead_m * share,
            ]
        )
        along = rng.normal(0, 1, 3)
        along /= np.linalg.norm(along)
        size = rng.uniform(0.1, 0.8), rng.uniform(0.003, 0.015)
        frame.things.append(Cone(middle, along, *size))
    mask = frame.owner == 1
    frame.render()
    return _measured(rng, frame, mask, False)


ROWS = {
    "second-behind": _two((1.05, 1.7), (0.3, 1.1)),
    "second-close": _two((1.02, 1.15), (0.7, 1.3)),
    "second-beside": beside,
    "second-behind-keypoints": _two((1.05, 1.7), (0.3, 1.1), keypoints=True),
    "second-in-front-keypoints": _two((0.6, 0.95), (0.4, 1.1), keypoints=True),
    "second-crossing": _two((1.05, 1.4), (0.3, 1.1), lean_deg=(8.0, 20.0)),
    "second-rock": _two((1.05, 1.3), (0.3, 1.1), top_m=(0.4, 1.2), diameter_m=(0.3, 0.8)),
    "fork-keypoints": _fork(keypoints=True),
    "fork-alone": _fork(keypoints=False),
    "fork-bent-keypoints": _fork(keypoints=True, bent=True),
    "fork-bent-alone": _fork(keypoints=False, bent=True),
    "branch-alone": branch,
    "single-oval": single_oval,
    "single-crude": single_crude,
    "single-smoothed": single_smoothed,
    "single-twigs": single_twigs,
}
