"""`edgetree bench`: the speed of a model on this machine."""

from __future__ import annotations

from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from edgetree.commands.options import Json, Model, Threads
from edgetree.console import note, print_json, progress

if TYPE_CHECKING:
    from edgetree.bench import BenchResult
    from edgetree.runtime import TreeDetector

__all__ = ["bench"]

_MOST_FRAMES = 16


def bench(
    source: Annotated[
        Path | None,
        typer.Argument(
            metavar="SOURCE", help="Frames as for `run`; the package's samples if not given."
        ),
    ] = None,
    model: Model = "rgb",
    duration_s: Annotated[
        float, typer.Option("--seconds", min=0.0, help="Time to measure for.")
    ] = 5.0,
    threads: Threads = None,
    as_json: Json = False,
) -> None:
    """Measure a model's latency, frames per second and memory on real frames."""
    from edgetree.commands.options import open_model

    detector, path = open_model(model, threads)
    images = _images(source, detector)
    result = _measure(detector, images, duration_s)
    record = _record(path, detector, len(images), result)
    if as_json:
        print_json(record)
        return
    for name, value in record.items():
        typer.echo(f"{name:16} {value}")
    note(f"next: edgetree run {source or 'IMAGE'} --model {model} --out pictures")


def _images(source: Path | None, detector: TreeDetector) -> list[Any]:
    """Some frames in memory, as the model takes them."""
    is_depth = detector.manifest.modality == "depth"
    if source is None:
        from edgetree.samples import sample_frames

        return [frame.depth_m() if is_depth else frame.image() for frame in sample_frames()]
    from edgetree.sources import open_source

    frames = islice(open_source(source, depth_only=is_depth), _MOST_FRAMES)
    return [frame.depth_m if is_depth else frame.image for frame in frames]


def _measure(detector: TreeDetector, images: list[Any], duration_s: float) -> BenchResult:
    """The bench, with its progress in hundredths."""
    from edgetree.bench import bench_detector

    shown = 0
    with progress("benching", 100) as bar:

        def move(gone: float) -> None:
            nonlocal shown
            bar.update(round(gone * 100) - shown)
            shown = round(gone * 100)

        return bench_detector(detector, images, duration_s=duration_s, on_run=move)


def _record(path: Path, detector: TreeDetector, frames: int, result: BenchResult) -> dict[str, Any]:
    """The model and its figures as one JSON object."""
    manifest = detector.manifest
    return {
        "schema": "edgetree.bench/1",
        "model": str(path),
        "name": manifest.name,
        "modality": manifest.modality,
        "precision": manifest.precision,
        "input_px": [manifest.input.width, manifest.input.height],
        "parameters": manifest.parameters,
        "file_bytes": path.stat().st_size,
        "frames": frames,
        **result.to_dict(),
    }
