"""Measure the speed and memory use of a model."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.pairs import FrameImage

_WARMUP: Final = 3
_MIN_RUNS: Final = 5


@dataclass(frozen=True)
class BenchResult:
    """The result of a benchmark. Times include resizing, inference and reading the outputs.

    Attributes:
        runs: Number of timed detections.
        threads: Threads of one inference.
        detect_p50_ms: Median time of a detection.
        detect_p90_ms: 90th percentile of the time of a detection.
        fps: Detections per second, one at a time.
        trees_per_frame: Mean number of trees found.
        peak_memory_mib: Peak memory of this process so far; None if not known.
    """

    runs: int
    threads: int
    detect_p50_ms: float
    detect_p90_ms: float
    fps: float
    trees_per_frame: float
    peak_memory_mib: float | None

    def to_dict(self) -> dict[str, Any]:
        """The result as a JSON object, with numbers rounded to two digits."""
        values = asdict(self)
        return {
            name: round(value, 2) if isinstance(value, float) else value
            for name, value in values.items()
        }


def bench_detector(
    detector: TreeDetector,
    images: Sequence[FrameImage],
    *,
    duration_s: float = 5.0,
    on_run: Callable[[float], None] = lambda _: None,
) -> BenchResult:
    """Measure detections on the images in turn, after three detections to warm up.

    Args:
        detector: The model.
        images: Images as for `TreeDetector.detect`, at least one.
        duration_s: Time to measure for; at least five detections are measured.
        on_run: Called after each detection with the elapsed share of the time, 0 to 1.

    Raises:
        ValueError: `images` is empty.
    """
    times_ms, trees = call_times_ms(detector, images, duration_s=duration_s, on_run=on_run)
    return BenchResult(
        runs=len(times_ms),
        threads=detector.session.threads,
        detect_p50_ms=float(np.percentile(times_ms, 50)),
        detect_p90_ms=float(np.percentile(times_ms, 90)),
        fps=len(times_ms) / sum(times_ms) * 1000,
        trees_per_frame=trees / len(times_ms),
        peak_memory_mib=peak_memory_mib(),
    )


def call_times_ms(
    detector: TreeDetector,
    images: Sequence[FrameImage],
    *,
    batch: int = 1,
    duration_s: float = 5.0,
    on_begin: Callable[[], object] = lambda: None,
    on_run: Callable[[float], None] = lambda _: None,
) -> tuple[list[float], int]:
    """Time detections on the images in turn, after three to warm up.

    Args:
        detector: The model.
        images: Images as for `TreeDetector.detect`, at least one.
        batch: Images that are handed over together.
        duration_s: Time to measure for; at least five calls are measured.
        on_begin: Called between the warm-up and the first call that is timed.
        on_run: Called after each call with the elapsed share of the time, 0 to 1.

    Returns:
        The time of each call in milliseconds, and the number of trees that were found.

    Raises:
        ValueError: `images` is empty.
    """
    if not images:
        raise ValueError("images is empty: expected at least one")

    def call(number: int) -> int:
        if batch == 1:
            return len(detector.detect(images[number % len(images)]))
        first = number * batch
        chosen = [images[(first + index) % len(images)] for index in range(batch)]
        return sum(len(found) for found in detector.detect_batch(chosen))

    for number in range(_WARMUP):
        call(number)
    times_ms: list[float] = []
    trees = 0
    on_begin()
    begin = time.perf_counter()
    gone_s = 0.0
    while gone_s < duration_s or len(times_ms) < _MIN_RUNS:
        start = time.perf_counter()
        trees += call(len(times_ms))
        times_ms.append((time.perf_counter() - start) * 1000)
        gone_s = time.perf_counter() - begin
        on_run(min(gone_s / duration_s, 1.0) if duration_s > 0 else 1.0)
    return times_ms, trees


def model_record(manifest: Manifest) -> dict[str, Any]:
    """Size and cost of a model as a JSON object, with None for values that older files lack.

    `multiply_adds` and `flops` (two per multiply-add) count the whole graph for one frame, with
    `proposals` region proposals and `detections` output rows. `classifier` is the cost of the
    backbone as an ImageNet classifier at 224x224 px, as given in papers.
    """
    classifier = manifest.classifier
    boxes = next(output for output in manifest.outputs if output.name == "boxes")
    precision = (manifest.parity or {}).get("average_precision", {})
    return {
        "name": manifest.name,
        "backbone": manifest.backbone,
        "modality": manifest.modality,
        "target": manifest.target,
        "precision": manifest.precision,
        "input_px": [manifest.input.width, manifest.input.height],
        "parameters": manifest.parameters,
        "multiply_adds": manifest.multiply_adds,
        "flops": _flops(manifest.multiply_adds),
        "proposals": manifest.proposals,
        "detections": boxes.shape[1],
        "classifier": classifier
        and {
            "input_px": [224, 224],
            "parameters": classifier.parameters,
            "multiply_adds": classifier.multiply_adds,
            "flops": _flops(classifier.multiply_adds),
        },
        "trained": manifest.training_data != "untrained",
        "box_ap": precision.get("box", {}).get("file"),
    }


def _flops(multiply_adds: int | None) -> int | None:
    return None if multiply_adds is None else 2 * multiply_adds


def peak_memory_mib() -> float | None:
    """Peak resident memory of this process so far, in MiB; None if not known."""
    status = Path("/proc/self/status")
    if status.is_file():
        for line in status.read_text(encoding="ascii", errors="replace").splitlines():
            if line.startswith("VmHWM:"):
                return float(line.split()[1]) / 1024
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / 1024**2  # bytes on macOS; on Linux /proc was used above
