"""Measure stems in stereo pairs of rendered pictures, whose truth is known.

python -m benchmarks.stereo --seeds 1000 1040 --result benchmarks/results/stereo.json

Stems and sloping ground of `benchmarks.metres` are seen by two cameras 12 cm apart. Bark and ground
have a texture of random values in space, which is the same for both cameras; each picture has noise
of its own. Masks are exact.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from basetree.arrays import Float, UInt8
from benchmarks.metres.caster import FARTHEST_M, Ground, cast
from benchmarks.metres.scores import lines, score
from benchmarks.metres.stand import Stand, Stem
from calib import PinholeCamera, RigidTransform, pixels_to_rays
from calib.stereo import StereoPair
from edgetree.frames.pipeline import with_noise
from edgetree.measure import EXACT_RIG, MeasureSettings, TreeMeasurement
from edgetree.sources.stereo import stereo_noise

CAMERAS: Final = {
    "1280x720": PinholeCamera(1280, 720, 700.0, 700.0, 639.5, 359.5),
    "640x480": PinholeCamera(640, 480, 480.0, 480.0, 319.5, 239.5),
}
BASELINE_M: Final = 0.12
_CELLS_M: Final = (0.4, 0.13, 0.045, 0.015)
_CONTRAST: Final = (22.0, 20.0, 18.0, 16.0)
_NOISE: Final = 2.0  # grey levels
_VOLUME: Final = 64
_ROUND: Final = MeasureSettings(out_of_round_std=0.003)  # as the stems are


def _texture(points_m: Float, footprint_m: Float, volumes: Float) -> Float:
    """Random values in space (...), of several sizes; those below a pixel's footprint fade."""
    total = np.zeros(points_m.shape[:-1])
    for volume, cell_m, contrast in zip(volumes, _CELLS_M, _CONTRAST, strict=True):
        at = points_m / cell_m
        low = np.floor(at).astype(int)
        part = at - low
        value = np.zeros(total.shape)
        for corner in range(8):
            step = np.array([corner & 1, corner >> 1 & 1, corner >> 2 & 1])
            weight = np.where(step, part, 1 - part).prod(-1)
            cell = (low + step) % _VOLUME
            value += weight * volume[cell[..., 0], cell[..., 1], cell[..., 2]]
        total += contrast * np.clip(cell_m / footprint_m - 1, 0, 1) * value
    return total


def _stand(rng: np.random.Generator, camera: PinholeCamera) -> Stand:
    ahead = rng.uniform(2.5, 8.0, 3)
    right = np.array([-0.45, 0.0, 0.45]) * ahead + rng.uniform(-0.1, 0.1, 3) * ahead
    stems = [
        Stem(
            rng.uniform(0.1, 0.5),
            *place,
            lean_deg=rng.uniform(0, 6),
            lean_towards_deg=rng.uniform(0, 360),
        )
        for place in zip(right, ahead, strict=True)
    ]
    return Stand(
        stems,
        camera,
        camera_height_m=rng.uniform(1.5, 2.2),
        pitch_deg=rng.uniform(3, 12),
        slope_deg=rng.uniform(0, 8),
        uphill_deg=rng.uniform(0, 360),
        bumps_std_m=0.0,
    )


def _picture(stand: Stand, across_m: float, volumes: Float, rng: np.random.Generator) -> UInt8:
    """What a camera sees that stands so far to the right of the stand's own."""
    aside = np.array([across_m, 0.0, 0.0])
    level = stand.to_camera.T @ aside
    height_m = stand.camera_height_m - level[1] - float(level[[0, 2]] @ stand.gradient)
    ground = Ground(height_m, stand.gradient, np.zeros((4, 4)))
    cones = [replace(cone, start_m=cone.start_m - aside) for cone in stand.cones]
    depth_m, owner = cast(stand.camera, stand.to_camera, ground, cones)
    rows, columns = np.mgrid[: stand.camera.height, : stand.camera.width]
    rays = pixels_to_rays(stand.camera, np.stack([columns, rows], -1) + 0.5)
    safe_m = np.where(depth_m > 0, depth_m, FARTHEST_M)
    points_m = (rays * safe_m[..., None] + aside) @ stand.to_camera
    grey = np.where(owner > 0, 95.0, 135.0)
    grey = grey + _texture(points_m, safe_m / stand.camera.fx, volumes)
    grey = np.where(depth_m > 0, grey, 200.0) + _NOISE * rng.standard_normal(grey.shape)
    return np.repeat(np.clip(np.rint(grey), 0, 255).astype(np.uint8)[..., None], 3, axis=2)


def pair_of(camera: PinholeCamera) -> StereoPair:
    """The calibrated pair of the pictures."""
    return StereoPair(camera, camera, RigidTransform(np.eye(3), np.array([-BASELINE_M, 0, 0])))


def scene(seed: int, camera: PinholeCamera) -> tuple[Stand, UInt8, UInt8]:
    """A stand with its left and right picture."""
    rng = np.random.default_rng(seed)
    stand = _stand(rng, camera)
    volumes = rng.uniform(-1, 1, (len(_CELLS_M), _VOLUME, _VOLUME, _VOLUME))
    left, right = (_picture(stand, across, volumes, rng) for across in (0.0, BASELINE_M))
    return stand, left, right


def readings(
    seeds: range, camera: PinholeCamera, errors: list[float], times_s: list[float]
) -> Iterator[tuple[TreeMeasurement, dict[str, Any]]]:
    """Measurements and true values; disparity errors in their deviations, and times, are added."""
    rectified = pair_of(camera).rectified
    for seed in seeds:
        stand, left, right = scene(seed, camera)
        start_s = time.perf_counter()
        found = rectified.depth(left, right)
        times_s.append(time.perf_counter() - start_s)
        both = (found.depth_m > 0) & (stand.depth_m > 0)
        off = (found.depth_m - stand.depth_m)[both] / found.std_m[both]
        errors += off[:: max(1, off.size // 500)].tolist()
        noise = stereo_noise(found, rectified)
        stand.depth_m = found.depth_m
        settings = with_noise(_ROUND, noise)
        yield from stand.readings(settings=settings, rig_uncertainty=EXACT_RIG)


def main() -> None:
    """Render, match, measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--seeds", type=int, nargs=2, default=(1000, 1040))
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    report: dict[str, Any] = {}
    for name, camera in CAMERAS.items():
        errors: list[float] = []
        times_s: list[float] = []
        scores = score(readings(range(*options.seeds), camera, errors, times_s))
        inside = np.mean(np.abs(errors) < 2)
        matching = {
            "median_ms": round(1000 * float(np.median(times_s)), 1),
            "median_std": round(float(np.median(np.abs(errors))) / 0.6745, 2),
            "inside_two_std": round(float(inside), 3),
        }
        report[name] = {"matching": matching, **scores}
        sys.stdout.write("\n".join([f"{name}: {matching}", *lines(name, scores)]) + "\n")
        sys.stdout.flush()
    if options.result is not None:
        options.result.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
