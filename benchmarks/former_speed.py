"""Time of model files as a share of that of former files, in turn.

python -m benchmarks.former_speed --former old/edge-n-rgb.onnx old/edge-s.onnx \\
    --now edge-n-rgb.onnx edge-s.onnx --result benchmarks/results/former_speed.json

Files are compared in the order in which they are given. In each round both see the same sample
frame. `share` is the median over the rounds of the new file's time divided by the former's, so
that other load on the machine matters little; `lowest_ms` are the shortest times of both.
"""

from __future__ import annotations

import statistics
from pathlib import Path
from typing import Any

from benchmarks.tools.program import finish, machine, note, program
from benchmarks.tools.timing import in_turn
from edgetree import SampleFrame, TreeDetector, sample_frames


def compare(former: Path, now: Path, threads: int, rounds: int) -> dict[str, Any]:
    """Time `detect` of both files on the sample frames."""
    frames = sample_frames()
    calls = {
        path: _detection(TreeDetector.load(path, threads=threads), frames) for path in (former, now)
    }
    times_ms = in_turn(calls, rounds, warm_up=len(frames))
    pairs = zip(times_ms[now], times_ms[former], strict=True)
    return {
        "share": round(statistics.median(own / other for own, other in pairs), 3),
        "lowest_ms": {
            "former": round(min(times_ms[former]), 2),
            "now": round(min(times_ms[now]), 2),
        },
    }


def _detection(detector: TreeDetector, frames: list[SampleFrame]) -> Any:
    """A call that detects the trees of the frame of a round."""
    manifest = detector.manifest
    depths = [each.depth_m() if manifest.takes_both else None for each in frames]
    images = [each.depth_m() if manifest.takes_depth else each.image() for each in frames]

    def detect(number: int) -> object:
        place = number % len(frames)
        return detector.detect(images[place], depth_m=depths[place])

    return detect


def main() -> None:
    """Compare each pair of files with one thread and with two."""
    parser = program(__doc__)
    parser.add_argument("--former", type=Path, nargs="+", required=True)
    parser.add_argument("--now", type=Path, nargs="+", required=True)
    parser.add_argument("--rounds", type=int, default=150)
    arguments = parser.parse_args()
    if len(arguments.former) != len(arguments.now):
        parser.error(
            f"--former has {len(arguments.former)} files and --now {len(arguments.now)}:"
            " expected as many"
        )
    files: dict[str, Any] = {}
    for former, now in zip(arguments.former, arguments.now, strict=True):
        note(now)
        files[now.stem] = {
            f"{threads} threads": compare(former, now, threads, arguments.rounds)
            for threads in (1, 2)
        }
    result = {"machine": machine(), "rounds": arguments.rounds, "files": files}
    finish(result, arguments.result)


if __name__ == "__main__":
    main()
