"""`edgetree bench`: measure the speed of a model, or of several networks as in the paper."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from edgetree.commands.option_groups import SessionOptions, expand_groups
from edgetree.commands.options import Json
from edgetree.console import note, print_json, progress

if TYPE_CHECKING:
    from edgetree.bench.speed import BenchResult
    from edgetree.commands.frame_results import LeftOut
    from edgetree.frames.sources import Frame
    from edgetree.runtime.detector import TreeDetector

__all__ = ["bench"]

_MAX_FRAMES = 16

_Source: TypeAlias = Annotated[
    Path | None,
    typer.Argument(
        metavar="SOURCE", help="Frames as for `run`; the packaged samples if not given."
    ),
]
_OneModel: TypeAlias = Annotated[
    str | None,
    typer.Option(help="An exported .onnx file, or the packaged model rgb (the default) or depth."),
]
_Seconds: TypeAlias = Annotated[
    float, typer.Option("--seconds", min=0.0, help="Time to measure each model for.")
]
_Backbones: TypeAlias = Annotated[
    str | None,
    typer.Option(
        metavar="LIST",
        help="Measure several networks, such as r50,r101,x101-32x8d,edge-n, and print the paper's"
        " table. Networks without a file in --models are exported with untrained weights.",
    ),
]
_Models: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        metavar="DIR",
        help="With --backbones: folder of NAME-PRECISION-WIDTHxHEIGHT.onnx files; your cache"
        " folder if not given.",
    ),
]
_Precision: TypeAlias = Annotated[
    str | None, typer.Option(help="With --backbones: fp32 (the default), fp16 or int8.")
]
_Height: TypeAlias = Annotated[
    int | None, typer.Option(help="With --backbones: input height in px; 800 if not given.")
]
_Width: TypeAlias = Annotated[
    int | None, typer.Option(help="With --backbones: input width in px; 800 if not given.")
]
_Proposals: TypeAlias = Annotated[
    int | None,
    typer.Option(
        min=1,
        help="With --backbones: region proposals per frame; each network's default if not given.",
    ),
]


@expand_groups
def bench(
    source: _Source = None,
    *,
    model: _OneModel = None,
    duration_s: _Seconds = 5.0,
    session: SessionOptions,
    backbones: _Backbones = None,
    models: _Models = None,
    precision: _Precision = None,
    height: _Height = None,
    width: _Width = None,
    proposals: _Proposals = None,
    as_json: Json = False,
) -> None:
    """Measure a model's latency, frames per second and memory.

    With --backbones, measure several networks and compare them with the paper's figures.
    """
    table_options = {
        "models": models,
        "precision": precision,
        "height": height,
        "width": width,
        "proposals": proposals,
    }
    given = {name: value for name, value in table_options.items() if value is not None}
    if backbones is None:
        _refuse(given, "without --backbones: expected both")
        _bench_one(source, model or "rgb", duration_s, session, as_json)
        return
    _refuse({} if model is None else {"model": model}, "with --backbones: expected only one")
    names = tuple(name.strip() for name in backbones.split(","))
    bench_options = {"source": source, "duration_s": duration_s, **asdict(session)}
    _bench_table(names, bench_options | given, as_json)


def _refuse(given: Mapping[str, Any], why: str) -> None:
    from edgetree.errors import InputError

    if given:
        raise InputError(f"{', '.join(f'--{name}' for name in given)} given {why}")


def _bench_table(names: tuple[str, ...], options: Mapping[str, Any], as_json: bool) -> None:
    """Measure several networks and print the paper's table."""
    from edgetree.bench.files import TableSettings, bench_in_turn, cache_folder, find_files
    from edgetree.bench.paper_table import table_lines, table_record

    settings = TableSettings(names, **{"models": cache_folder(), **options})
    files = find_files(settings, note)
    note(f"models: {settings.models}")
    record = table_record(bench_in_turn(files, settings, note))
    if as_json:
        print_json(record)
        return
    for line in table_lines(record):
        typer.echo(line)
    note(f"next: edgetree bench --model {files[names[0]]}")


def _bench_one(
    source: Path | None,
    model: str,
    duration_s: float,
    session: SessionOptions,
    as_json: bool,
) -> None:
    """Measure one model and print the figures."""
    from edgetree.commands.frame_results import LeftOut

    detector, path = session.open_model(model)
    left_out = LeftOut(strict=source is None or not source.is_dir())
    images = _images(source, detector, left_out)
    left_out.check_some(len(images))
    result = _measure(detector, images, duration_s)
    record = _record(path, detector, len(images), result)
    if as_json:
        print_json(record)
    else:
        for name, value in _flat(record):
            typer.echo(f"{name:26} {value}")
    left_out.check_none(len(images))
    if as_json:
        return
    note(f"next: edgetree run {source or 'IMAGE'} --model {model} --out pictures")


def _flat(record: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """The entries of a record that are not None; nested entries as `parent_child`."""
    for name, value in record.items():
        if name == "nodes":
            yield from ((f"nodes_on_{part}", _nodes(part, value[part])) for part in value)
        elif isinstance(value, dict):
            yield from ((f"{name}_{key}", item) for key, item in _flat(value))
        elif value is not None:
            yield name, value


def _nodes(provider: str, operators: Mapping[str, int]) -> str:
    """Number of nodes that a provider runs; for the CPU, with the names of the operators."""
    count = sum(operators.values())
    names = ", ".join(f"{name} {number}" for name, number in sorted(operators.items()))
    return f"{count} ({names})" if provider == "cpu" else str(count)


def _images(source: Path | None, detector: TreeDetector, left_out: LeftOut) -> list[Any]:
    """The first frames of the source in memory, as the model takes them."""
    from edgetree.frames.pipeline import image_for, open_frames, readable
    from edgetree.samples import sample_frames

    frames: Iterator[Frame]
    if source is None:
        frames = (sample.read() for sample in sample_frames())
    else:
        opened = open_frames(source, detector=detector)
        frames = islice(readable(opened, left_out.add), _MAX_FRAMES)
    return [image_for(detector, frame) for frame in frames]


def _measure(detector: TreeDetector, images: list[Any], duration_s: float) -> BenchResult:
    """Run the benchmark with a progress bar in percent."""
    from edgetree.bench.speed import bench_detector

    shown = 0
    with progress("measuring speed", 100) as bar:

        def move(gone: float) -> None:
            nonlocal shown
            bar.update(round(gone * 100) - shown)
            shown = round(gone * 100)

        return bench_detector(detector, images, duration_s=duration_s, on_run=move)


def _record(path: Path, detector: TreeDetector, frames: int, result: BenchResult) -> dict[str, Any]:
    """The model and the result as one JSON object."""
    from edgetree.bench.speed import model_record

    return {
        "schema": "edgetree.bench/1",
        "model": str(path),
        **model_record(detector.manifest),
        "file_bytes": path.stat().st_size,
        "frames": frames,
        "provider": detector.session.provider,
        "nodes": getattr(detector.session, "placement", {}),
        **result.to_dict(),
    }
