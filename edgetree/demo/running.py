"""Run the demonstration: compare models with the ground truth, measure speed, write the report."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from basetree.files.writing import text_file
from edgetree.bench.speed import bench_detector, peak_memory_mib
from edgetree.demo.examine import examine
from edgetree.demo.report import NextCommand, render_report
from edgetree.demo.result import DemoResult, ModelResult
from edgetree.frames.pipeline import image_for
from edgetree.runtime import TreeDetector, default_model
from edgetree.samples import SampleFrame, sample_frames

Progress: TypeAlias = Callable[[float, str], None]
"""Function called with the share of the work done, 0 to 1, and a description of the next work."""

_BENCH_S: Final = 5.0


def run_embedded(on_progress: Progress) -> DemoResult:
    """Run the packaged depth and rgb models on the packaged sample frames."""
    models = [default_model("depth"), default_model("rgb")]
    return demonstrate(models, sample_frames(), on_progress)


def demonstrate(
    models: Sequence[Path], frames: Sequence[SampleFrame], on_progress: Progress
) -> DemoResult:
    """Detect, measure and compare all frames with each model, and measure each model's speed.

    Args:
        models: Model files; the report's summary is about the first.
        frames: Frames with ground truth.
        on_progress: Called with the progress.

    Raises:
        EdgetreeError: a model or a frame cannot be used.
    """
    start_s = time.perf_counter()
    results: list[ModelResult] = []
    for index, model in enumerate(models):

        def on_share(share: float, what: str, index: int = index) -> None:
            on_progress((index + share) / len(models), what)

        results.append(_run_model(model, frames, on_share))
    return DemoResult(
        models=tuple(results),
        duration_s=time.perf_counter() - start_s,
        peak_memory_mib=peak_memory_mib(),
    )


def _run_model(model: Path, frames: Sequence[SampleFrame], on_progress: Progress) -> ModelResult:
    detector = TreeDetector.load(model)
    modality = detector.manifest.modality
    comparisons = []
    for number, frame in enumerate(frames):
        on_progress(0.5 * number / len(frames), f"measuring {frame.name}, {modality}")
        comparisons.append(examine(detector, frame))
    speed = bench_detector(
        detector,
        [image_for(detector, frame.read()) for frame in frames],
        duration_s=_BENCH_S,
        on_run=lambda share: on_progress(0.5 + 0.5 * share, f"measuring speed, {modality}"),
    )
    return ModelResult(detector.manifest, model.stat().st_size, speed, tuple(comparisons))


def write_report(folder: Path, result: DemoResult, next_commands: Sequence[NextCommand]) -> Path:
    """Write `report.html` to a folder, atomically.

    Returns:
        The path of the report.

    Raises:
        InputError: The file cannot be written.
    """
    path = folder / "report.html"
    with text_file(path) as page:
        page.write(render_report(result, next_commands))
    return path
