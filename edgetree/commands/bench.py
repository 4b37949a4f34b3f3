"""`edgetree bench`: what models cost on this machine: time, memory, and where the time goes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.counts import counted
from basetree.program.console import complain, note, print_found
from basetree.program.options import expand_groups, given
from basetree.program.progress import Progress, steps_shown
from edgetree.commands.bench_options import BenchFiles, MeasureOptions, NetworkOptions
from edgetree.commands.options import Json

if TYPE_CHECKING:
    from edgetree.bench.files import NetworkFiles
    from edgetree.bench.rounds import BenchSettings, Variant
    from edgetree.commands.frame_results import LeftOut

_SPLIT = "test"
_Chosen: TypeAlias = tuple[str, Path, str | None]


@expand_groups
def bench(
    models_given: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[MODEL]...",
            help="Exported .onnx files, or names that `edgetree models` lists.",
            show_default="the default models, edge-s-rgb and edge-n-depth",
        ),
    ] = None,
    *,
    measure: MeasureOptions,
    networks: NetworkOptions,
    data: Annotated[
        Path | None,
        typer.Option(
            metavar="DATASET",
            help="Labelled dataset whose split test gives the accuracy. Needs the packages for"
            " training.",
            show_default="the models' cards",
            rich_help_panel="Measuring",
        ),
    ] = None,
    files: BenchFiles,
    as_json: Json = False,
) -> None:
    """Measure the latency, throughput, memory and cost of models, and what accuracy they give.

    All variants are measured in turn, each time in a process of its own. Keep the machine quiet.
    """
    from basetree.files.places import check_folders, check_paths
    from edgetree.bench.text_table import text_lines

    check_paths(
        {f"--{name}": path for name, path in asdict(files).items()},
        {"--frames": measure.frames, "--data": data}
        | {f"model {name}": Path(name) for name in models_given or [] if Path(name).is_file()},
    )
    check_folders(asdict(files).values())
    if data is not None:
        from edgetree.evaluate import check_dataset

        check_dataset(data, _SPLIT)
    chosen = _chosen(models_given or [], networks, measure.provider)
    settings = _settings(measure)
    variants, network_of = _variants(chosen, measure)
    left_out, frames = _look_at_frames(measure, variants[0].path)
    result = _result(variants, network_of, settings, data, frames)
    print_found(as_json, lambda: result, lambda: text_lines(result))
    _write(result, files)
    left_out.check_none(frames)


def _chosen(names: list[str], networks: NetworkOptions, provider: str) -> list[_Chosen]:
    """Name, file and network of each model to measure."""
    from edgetree.catalogue import MODALITIES, find_model

    listed = networks.network_files(provider)
    chosen: list[_Chosen] = []
    for name in names or ([] if listed else MODALITIES):
        path = find_model(name)
        chosen.append((path.stem, path, None))
    stems = [stem for stem, *_ in chosen]
    chosen = [
        (stem if stems.count(stem) == 1 else f"{path.parent.name}/{stem}", path, network)
        for stem, path, network in chosen
    ]
    return chosen if listed is None else chosen + _network_files(listed)


def _network_files(listed: NetworkFiles) -> list[_Chosen]:
    """The files of networks by name; without the packages for exporting, those that are there."""
    from basetree.errors import MissingPackage
    from edgetree.catalogue import known_models

    try:
        _export_missing(listed)
    except MissingPackage as error:
        found = [file for file in listed.files() if file.path.is_file()]
        chosen = [(file.network, file.path, file.network) for file in found]
        for network in listed.networks:
            if network not in {file.network for file in found}:
                names = [model for model in known_models() if model.name.startswith(f"{network}-")]
                chosen += [(model.name, model.path, network) for model in names]
        if {network for *_, network in chosen} != set(listed.networks):
            raise
        note(f"using the files that are there: {error}")
        return list(chosen)
    return [(file.network, file.path, file.network) for file in listed.files()]


def _export_missing(listed: NetworkFiles) -> None:
    """Export the networks without a file, and say first which are there and which are not."""
    missing = listed.missing()
    there = len(listed.files()) - len(missing)
    note(f"{there} of {counted(len(listed.files()), 'file')} found in {listed.folder}, used again")
    if not missing:
        return
    names = ", ".join(each.path.name for each in missing)
    note(f"exported before the measurement, which takes minutes each: {names}")
    with steps_shown("exporting") as say:
        listed.export_missing(say)


def _settings(measure: MeasureOptions) -> BenchSettings:
    from edgetree.bench.rounds import BenchSettings
    from edgetree.signing.verify import is_signature_required

    return BenchSettings(
        **given(measure, BenchSettings),
        duration_s=measure.seconds,
        require_signature=is_signature_required(),
        source=measure.frames,
    )


def _variants(
    chosen: list[_Chosen], measure: MeasureOptions
) -> tuple[list[Variant], list[str | None]]:
    """All combinations of models, threads and batches, and the network of each."""
    from edgetree.bench.rounds import Variant

    made = [
        (Variant(name, path, threads, batch), network)
        for name, path, network in chosen
        for threads in measure.thread_counts()
        for batch in measure.batches()
    ]
    return [each[0] for each in made], [each[1] for each in made]


def _look_at_frames(measure: MeasureOptions, model: Path) -> tuple[LeftOut, int]:
    """Read the frames once, so that broken ones are named; their number."""
    from edgetree.bench.frames import bench_frames
    from edgetree.commands.frame_results import LeftOut
    from edgetree.runtime.detector import TreeDetector

    source = measure.frames
    left_out = LeftOut(strict=source is None or not source.is_dir())
    detector = TreeDetector.load(model, provider=measure.provider, strict=measure.strict)
    count = len(bench_frames(source, detector, left_out.add))
    left_out.check_some(count)
    return left_out, count


def _result(
    variants: list[Variant],
    network_of: list[str | None],
    settings: BenchSettings,
    data: Path | None,
    frames: int,
) -> dict[str, Any]:
    from basetree.program.load import busy_words
    from edgetree.bench.result import make_result
    from edgetree.bench.rounds import count_runs, measure_variants
    from edgetree.commands.bench_accuracy import accuracy_of
    from edgetree.runtime.providers import SessionSettings

    environment = _environment()
    if busy := busy_words(environment["busy_cores"], environment["cores"]):
        complain(f"{busy}: times will be too long, and no variant will be called the fastest")
    known: dict[Path, Any] = {}
    if data is not None:  # first, so that data which do not suit a model cost no measurement
        note(f"evaluating on {data}")
        session = SessionSettings(
            settings.provider, settings.strict, require_signature=settings.require_signature
        )
        paths = dict.fromkeys(variant.path for variant in variants)
        known = {path: accuracy_of(path, data, _SPLIT, session) for path in paths}
    with Progress("measuring", count_runs(variants, settings), "run") as step:
        measured = measure_variants(variants, settings, note, lambda: step.update(1))
    for variant, row in zip(variants, measured["rows"], strict=True):
        if variant.path not in known:
            trained = row["trained"]
            known[variant.path] = accuracy_of(variant.path, None, _SPLIT) if trained else None
        row["accuracy"] = known[variant.path]
    where = "the packaged samples" if settings.source is None else str(settings.source)
    method = {
        "rounds": settings.rounds,
        "duration_s": settings.duration_s,
        "minutes": settings.minutes,
        "frames": f"{counted(frames, 'frame')} of {where}",
    }
    return make_result(measured, environment, method, network_of)


def _environment() -> dict[str, Any]:
    """The machine, its load before the benchmark, and the versions of the libraries."""
    import platform
    from importlib.metadata import version

    import cv2
    import numpy

    from edgetree.doctor.machine import examine_machine
    from edgetree.runtime.providers import import_onnxruntime

    return {
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        **asdict(examine_machine()),
        "edgetree": version("edgetree"),
        "python": platform.python_version(),
        "onnxruntime": import_onnxruntime().__version__,
        "numpy": numpy.__version__,
        "opencv": cv2.__version__,
    }


def _write(result: dict[str, Any], files: BenchFiles) -> None:
    """Write the files; one that cannot be written does not keep the others from it."""
    import json

    from basetree.files.writing import UnwritableFile, text_file
    from edgetree.bench.page import page_html
    from edgetree.bench.result import csv_text, markdown_text

    makers: dict[Path | None, Callable[[], Iterable[str]]] = {
        files.out: lambda: [json.dumps(result, indent=1, allow_nan=False), "\n"],
        files.csv: lambda: [csv_text(result)],
        files.markdown: lambda: [markdown_text(result)],
        files.report: lambda: page_html(result),
    }
    unwritten: list[UnwritableFile] = []
    for path, make in makers.items():
        if path is not None:
            try:
                with text_file(path) as stream:
                    stream.writelines(make())
                note(f"written: {path}")
            except UnwritableFile as error:
                unwritten.append(error)
    for other in unwritten[1:]:
        complain(str(other))
    if unwritten:
        raise unwritten[0]
