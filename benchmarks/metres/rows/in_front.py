"""Things in front of stems: a branch before a stem without depth, netting, brush."""

from __future__ import annotations

import cv2
import numpy as np

from basetree.arrays import Bool
from benchmarks.metres.caster import Cone, smooth_noise
from benchmarks.metres.rows.clean import Readings, stand, stem
from benchmarks.metres.sensors import stereo_noise, without
from benchmarks.metres.stand import Stand, Stem


def measured(frame: Stand, rng: np.random.Generator, masks: list[Bool]) -> Readings:
    """Measure by masks that a caller gives, or by those of a detector, as often."""
    given = masks if rng.random() < 0.5 else None
    return frame.readings(frame.detections(rng, masks=masks), given_masks=given)


def _twig(rng: np.random.Generator, frame: Stand, tree: Stem) -> Cone:
    """A branch that crosses the line of sight to a stem."""
    share = rng.uniform(0.25, 0.8)
    above_m = rng.uniform(0.5, 2.0)
    middle = np.array([tree.right_m * share, frame.camera_height_m - above_m, tree.ahead_m * share])
    along = np.array([rng.choice([-1.0, 1.0]), rng.normal(0, 0.5), rng.normal(0, 0.3)])
    along /= np.linalg.norm(along)
    length_m = rng.uniform(1, 3)
    return Cone(middle - length_m / 2 * along, along, length_m, rng.uniform(0.008, 0.04))


def branch(rng: np.random.Generator) -> Readings:
    """Bark too dark for depth but in patches, and one or two branches that have it."""
    tree = stem(rng)
    frame = stand(rng, [tree])
    masks = frame.masks()
    frame.things = [_twig(rng, frame, tree) for _ in range(rng.integers(1, 3))]
    frame.render()
    patches = cv2.resize(smooth_noise(rng, 64, 1.0), frame.owner.shape[::-1])
    read = patches > np.quantile(patches, rng.choice([0.9, 0.97, 1.0, 1.0]))
    bark = masks[0] & (frame.owner == 1)
    frame.depth_m = stereo_noise(without(frame.depth_m, bark & ~read), rng)
    return measured(frame, rng, masks)


def netting(rng: np.random.Generator) -> Readings:
    """A fence with wires one way or both, over 30 to 80 % of the picture."""
    tree = stem(rng)
    frame = stand(rng, [tree])
    height, width = frame.depth_m.shape
    rows, columns = np.mgrid[:height, :width]
    pitch_px, share, turn = rng.integers(6, 16), rng.uniform(0.3, 0.8), rng.uniform(-0.1, 0.1)
    both_ways = rng.random() < 0.5
    wire_px = pitch_px * (1 - np.sqrt(1 - share) if both_ways else share)
    wire = (rows - turn * columns) % pitch_px < wire_px
    if both_ways:
        wire |= (columns + turn * rows) % pitch_px < wire_px
    across, down = rng.normal(0, 0.1, 2)
    tilt = 1 + across * (columns / width - 0.5) + down * (rows / height - 0.5)
    fence_m = tree.ahead_m * rng.uniform(0.35, 0.85) * tilt
    before = wire & ((frame.depth_m == 0) | (fence_m < frame.depth_m))
    masks = frame.masks()
    depth_m = np.where(before, fence_m, frame.depth_m).astype(np.float32)
    frame.depth_m = stereo_noise(depth_m, rng)
    return measured(frame, rng, masks)


def brush(rng: np.random.Generator) -> Readings:
    """Forty to two hundred twigs of some millimetres around one place before the stem."""
    tree = stem(rng)
    frame = stand(rng, [tree])
    masks = frame.masks()
    share = rng.uniform(0.35, 0.85)
    for _ in range(rng.integers(40, 200)):
        here = share * rng.uniform(0.8, 1.15)
        place = np.array(
            [
                tree.right_m * here + rng.normal(0, 0.3),
                frame.camera_height_m - rng.uniform(0, 2.2),
                tree.ahead_m * here,
            ]
        )
        along = rng.normal(0, 1, 3)
        along /= np.linalg.norm(along)
        thick_m, length_m = rng.uniform(0.003, 0.012), rng.uniform(0.1, 0.6)
        frame.things.append(Cone(place, along, length_m, thick_m))
    frame.render()
    frame.depth_m = stereo_noise(frame.depth_m, rng)
    return measured(frame, rng, masks)


ROWS = {"branch": branch, "netting": netting, "brush": brush}
