"""Following and fusing stems over simulated drives: identities, errors, intervals and time.

perceptree synth --out drives --preset drive --frames 2000 --views 200 --width 640 --height 360
python -m benchmarks.tracking drives --result benchmarks/results/tracking.json

The scores of identities need scipy, those of ByteTrack `supervision` before 0.27; without these
packages they are left out. `--cache` keeps detections and measurements. The shares of errors in
`TrackingSettings` are the ones that this program prints.
"""

from __future__ import annotations

import importlib.util
import math
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.tools.program import finish, program
from benchmarks.tools.timing import time_ms
from benchmarks.tracking_drives import DriveFrame, load_drives
from benchmarks.tracking_fusion import (
    PLACE,
    TRUTHS,
    Row,
    best_single_frame,
    coverage,
    error_shares,
    fused_rows,
    single_frames,
)
from benchmarks.tracking_plot import plot
from benchmarks.tracking_scores import ScoredFrame, byte_track, has_byte_track, scores
from benchmarks.tracking_stand import twenty_stems
from edgetree import TreeDetections, TreeDetector
from edgetree.catalogue import default_model
from edgetree.frames.frame import Frame
from edgetree.live.tracking import (
    DepthOdometry,
    ErrorShares,
    StemTracker,
    TrackingSettings,
    TreeTrack,
)
from edgetree.measure import TreeMeasurement

# What the tracker is given: the pose, the vertical, and the depth image.
Given = tuple[bool, bool, bool]
KNOWN: dict[str, Given] = {
    "pose": (True, True, False),
    "vertical": (False, True, False),
    "nothing": (False, False, False),
}
# With the package small_gicp.
BY_DEPTH: dict[str, Given] = {
    "vertical and depth": (False, True, True),
    "depth": (False, False, True),
}
# One in so many frames is used.
STEPS = (1, 2, 5)
_RATE_HZ = 10.0
POSE = KNOWN["pose"]
# A drive is followed from one in so many frames on, if so many are left.
_START_EVERY, _SHORTEST = 25, 5

Tracks = list[list[TreeTrack]]


def main() -> None:
    """Follow the drives."""
    parser = program(__doc__)
    parser.add_argument("data", type=Path, nargs="+", help="folders of drives")
    parser.add_argument("--model", type=Path, help="depth model; default: the embedded one")
    parser.add_argument("--cache", type=Path, help="folder for detections and measurements")
    parser.add_argument("--plot", type=Path, help="file for a plot, .png")
    arguments = parser.parse_args()
    if arguments.cache is not None:
        arguments.cache.mkdir(parents=True, exist_ok=True)
    detector = TreeDetector.load(arguments.model or default_model("depth"))
    drives = load_drives(arguments.data, detector, arguments.cache)
    result = {
        "drives": len(drives),
        "frames": sum(map(len, drives.values())),
        "stems": sum(
            len({label["stem"] for frame in drive for label in frame.labels})
            for drive in drives.values()
        ),
        "shares": {quantity: error_shares(drives.values(), quantity) for quantity in TRUTHS},
        "single_frames": single_frames(drives.values()),
        "fusion": fusion(drives),
        "identities": identities(drives),
        "speed": speed(drives),
    }
    finish(result, arguments.result)
    if arguments.plot is not None:
        plot(result, arguments.plot)


def followed(
    drive: list[DriveFrame], given: Given, settings: TrackingSettings | None = None
) -> Tracks:
    """The tracks after each frame of a drive."""
    tracker = StemTracker(settings, DepthOdometry() if given[2] else None)
    return [tracker.update(frame.live(*given), frame.trees, frame.measurements) for frame in drive]


def known_here() -> dict[str, Given]:
    """What the tracker is given, as far as the packages for it are installed."""
    return KNOWN if importlib.util.find_spec("small_gicp") is None else KNOWN | BY_DEPTH


def settings_without(drives: dict[str, list[DriveFrame]], name: str) -> TrackingSettings:
    """Settings with the shares of errors that all drives but one tell."""
    others = [drive for other, drive in drives.items() if other != name]
    fitted: dict[str, Any] = {}
    for quantity in TRUTHS:
        shares = error_shares(others, quantity)
        fitted[quantity.rsplit("_", 1)[0]] = ErrorShares(
            shares["bias"], shares["view"], shares["noise"]
        )
    return replace(TrackingSettings(), **fitted)


def fusion(drives: dict[str, list[DriveFrame]]) -> dict[str, Any]:
    """Errors and intervals of fused values.

    Each drive is followed from several frames on, so that stems are met in the middle of their way
    through the picture too, and not only where they enter it.
    """
    noise = replace(TrackingSettings(), diameter=ErrorShares(0.0, 0.0, 1.0))
    result: dict[str, Any] = {
        known: _fused(drives, lambda name: TrackingSettings(), given, list(TRUTHS))
        for known, given in known_here().items()
    }
    result["pose"][PLACE] = _fused(drives, lambda name: TrackingSettings(), POSE, [PLACE])[PLACE]
    result["pose, all errors as noise"] = _fused(drives, lambda name: noise, POSE, ["diameter_m"])
    if len(drives) > 1:
        result["pose, shares of the other drives"] = _fused(
            drives, lambda name: settings_without(drives, name), POSE, list(TRUTHS)
        )
    return result


def _fused(
    drives: dict[str, list[DriveFrame]],
    settings_for: Callable[[str], TrackingSettings],
    given: Given,
    quantities: list[str],
) -> dict[str, Any]:
    rows: dict[str, list[list[Row]]] = {quantity: [] for quantity in quantities}
    singles = []
    for number, (name, drive) in enumerate(drives.items()):
        settings = settings_for(name)
        for start in range(0, len(drive) - _SHORTEST, _START_EVERY):
            part = drive[start:]
            tracks = followed(part, given, settings)
            for quantity in quantities:
                for each in fused_rows(part, tracks, quantity).values():
                    rows[quantity].append([(*row[:4], number * 10_000 + row[4]) for row in each])
            if start == 0:
                singles += best_single_frame(part, tracks)
    result: dict[str, Any] = {quantity: coverage(each) for quantity, each in rows.items()}
    if singles:
        result["best_single_frame"] = _gain(np.array(singles))
    return result


def _gain(rows: np.ndarray) -> dict[str, float | int]:
    """How much better fused diameters are than those of the most certain frames."""
    single, single_std, fused, fused_std = rows.T
    values = {
        "single_rmse_m": math.sqrt(np.mean(single**2)),
        "fused_rmse_m": math.sqrt(np.mean(fused**2)),
        "single_median_abs_m": np.median(np.abs(single)),
        "fused_median_abs_m": np.median(np.abs(fused)),
        "single_median_std_m": np.median(single_std),
        "fused_median_std_m": np.median(fused_std),
        "single_held": np.mean(np.abs(single) <= 1.96 * single_std),
        "fused_held": np.mean(np.abs(fused) <= 1.96 * fused_std),
    }
    return {"stems": len(rows), **{name: round(float(each), 4) for name, each in values.items()}}


def identities(drives: dict[str, list[DriveFrame]]) -> dict[str, Any]:
    """IDF1 and HOTA at several frame rates, and of ByteTrack."""
    if importlib.util.find_spec("scipy") is None:
        return {"left_out": "scipy is not installed"}
    result: dict[str, Any] = {}
    for step in STEPS:
        thinned = [drive[::step] for drive in drives.values()]
        entry: dict[str, Any] = {
            known: scores(
                [
                    _scored(frame, *_boxes(frame, tracks))
                    for frame, tracks in zip(drive, followed(drive, given), strict=True)
                ]
                for drive in thinned
            )
            for known, given in known_here().items()
        }
        if has_byte_track():
            rate_hz = _RATE_HZ / step
            entry["bytetrack"] = scores(
                [
                    _scored(frame, *found)
                    for frame, found in zip(
                        drive, byte_track([frame.trees for frame in drive], rate_hz), strict=True
                    )
                ]
                for drive in thinned
            )
        result[f"{_RATE_HZ / step:g} Hz"] = entry
    return result


def _boxes(frame: DriveFrame, tracks: list[TreeTrack]) -> tuple[np.ndarray, np.ndarray]:
    """Boxes and numbers of the stems that are seen in a frame."""
    seen = [(track.tree, track.number) for track in tracks if track.tree is not None]
    rows = np.array([tree for tree, _ in seen], int)
    return frame.trees.boxes_px[rows], np.array([number for _, number in seen], int)


def _scored(frame: DriveFrame, boxes: np.ndarray, numbers: np.ndarray) -> ScoredFrame:
    stems = np.array([label["stem"] for label in frame.labels], int)
    return frame.boxes, stems, boxes.astype(np.float64), numbers


def speed(drives: dict[str, list[DriveFrame]]) -> dict[str, Any]:
    """Time of one update in ms on one core, on the drives and with 20 stems in every frame."""
    result: dict[str, Any] = {"numpy_call_us": round(_call_us(), 2)}
    for known, given in known_here().items():
        times: list[float] = []
        for drive in drives.values():
            frames = [(frame.live(*given), frame.trees, frame.measurements) for frame in drive]
            times += _update_ms(frames, DepthOdometry() if given[2] else None)
        result[known] = _spread_ms("drives", times)
        if not given[2]:
            result[known] |= _spread_ms("stems20", _update_ms(twenty_stems(*given[:2]), None))
    return result


def _spread_ms(of: str, times: list[float]) -> dict[str, float]:
    return {
        f"{of}_median_ms": round(float(np.median(times)), 3),
        f"{of}_p95_ms": round(float(np.percentile(times, 95)), 3),
    }


def _update_ms(
    frames: list[tuple[Frame, TreeDetections, list[TreeMeasurement]]],
    odometry: DepthOdometry | None,
) -> list[float]:
    tracker, times = StemTracker(odometry=odometry), []
    for frame in frames:
        times.append(time_ms(partial(tracker.update, *frame), time.thread_time))
    return times


def _call_us() -> float:
    """Time of the smallest NumPy call, which tells how busy the processor is."""
    values, calls = np.zeros(3), 2000
    every_ms = time_ms(lambda: [values + 1 for _ in range(calls)], time.thread_time)
    return 1e3 * every_ms / calls


if __name__ == "__main__":
    main()
