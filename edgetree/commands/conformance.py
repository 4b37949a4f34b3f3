"""`edgetree conformance`: make a kit for programs in other languages, and check their results."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.counts import counted
from basetree.program.command_line import show_help
from basetree.program.console import note, print_found, print_json, tell
from basetree.program.help import new_app
from basetree.program.quoting import quoted
from edgetree.commands.options import Json, Provider, Threads

if TYPE_CHECKING:
    from edgetree.conformance import Comparison, Results

_MOST_LINES = 20

conformance = new_app(
    "Check that a program in another language finds the same trees with a model file."
)


@conformance.callback(invoke_without_command=True)
def options(context: typer.Context) -> None:
    """Print the help if no command is given."""
    show_help(context)


_Kit: TypeAlias = Annotated[
    Path, typer.Argument(metavar="KIT", help="Folder of `edgetree conformance make`.")
]


@conformance.command(epilog="edgetree conformance make edge-n-rgb --out kit")
def make(
    model: Annotated[
        str,
        typer.Argument(
            metavar="MODEL",
            help="An exported .onnx file, or the name of a model that `edgetree models` lists.",
        ),
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="KIT", help="Folder to make or replace.")],
    score_threshold: Annotated[
        float, typer.Option(min=0.0, max=1.0, help="Programs leave out trees with a lower score.")
    ] = 0.15,
    as_json: Json = False,
) -> None:
    """Make a kit: the model, raw frames and the trees that every program must find in them."""
    from edgetree.catalogue import find_model
    from edgetree.conformance import make_kit

    kit, expected = make_kit(find_model(model), out, score_threshold=score_threshold)
    trees = sum(len(frame.trees) for frame in expected.frames)
    if as_json:
        print_json(
            {
                "schema": "edgetree.conformance-make/1",
                "kit": str(out),
                "model_sha256": kit.model_sha256,
                "frames": len(kit.frames),
                "trees": trees,
                "covered": expected.covered,
            }
        )
        return
    tell(f"kit      {out}: {kit.name}, {kit.precision}")
    tell(f"frames   {len(kit.frames)}")
    tell(f"trees    {trees}, and {expected.covered} that a better one covers")
    if not trees:
        note("no tree in the frames: this kit cannot tell a right program from a wrong one")
    elif not expected.covered:
        note("no tree covers another: this kit does not test how programs leave such trees out")
    if kit.weight_bits == 8:
        note("weights of 8 bits: x86 processors without VNNI find other trees with this model")
    note(
        f"next: a program that writes RESULTS.json; edgetree conformance check"
        f" {quoted(out)} RESULTS.json",
        whole=True,
    )


@conformance.command(epilog="edgetree conformance run kit --out results.json")
def run(
    kit: _Kit,
    *,
    out: Annotated[Path, typer.Option(metavar="RESULTS.json", help="File to write.")],
    provider: Provider = "cpu",
    threads: Threads = None,
    rounds: Annotated[int, typer.Option(min=0, help="Passes over the frames that are timed.")] = 0,
) -> None:
    """Find a kit's trees with this package, as on another processor or provider."""
    from basetree.files.places import check_folders, check_paths
    from edgetree.conformance import run_kit, write_results
    from edgetree.conformance.kit import KIT_FILES

    check_paths({"--out": out}, {f"{name} of the kit": kit / name for name in KIT_FILES})
    check_folders([out])
    results = run_kit(kit, provider=provider, threads=threads, rounds=rounds)
    write_results(out, results)
    note(f"next: edgetree conformance check {quoted(kit)} {quoted(out)}", whole=True)


@conformance.command(epilog="edgetree conformance check kit results.json")
def check(
    kit: _Kit,
    results: Annotated[
        Path, typer.Argument(metavar="RESULTS.json", help="What a program found in the kit.")
    ],
    *,
    as_json: Json = False,
) -> None:
    """Compare what a program found with a kit. The exit code is 1 if it differs too much."""
    from edgetree.conformance import compare_results, read_results

    found = read_results(results)
    comparison = compare_results(kit, found)
    print_found(as_json, lambda: _record(found, comparison), lambda: _lines(found, comparison))
    if not comparison.passed:
        raise typer.Exit(1)


def _record(found: Results, comparison: Comparison) -> dict[str, Any]:
    return {
        "schema": "edgetree.conformance-check/1",
        "passed": comparison.passed,
        "host": found.host,
        "runtime": f"{found.runtime} {found.runtime_version}",
        "processor": found.processor,
        "median_ms": found.median_ms,
        "trees": comparison.trees,
        "unmatched": comparison.unmatched,
        "quantities": [dataclasses.asdict(each) for each in comparison.quantities],
        "tolerance": dataclasses.asdict(comparison.tolerance),
        "problems": list(comparison.problems),
    }


def _lines(found: Results, comparison: Comparison) -> Iterator[str]:
    runtime = f"{found.runtime} {found.runtime_version}"
    yield f"program         {found.host}: {runtime}, {found.processor}"
    if found.median_ms is not None:
        threads = "" if found.threads is None else f", {counted(found.threads, 'thread')}"
        yield f"time            {found.median_ms:.1f} ms a frame{threads}"
    yield f"trees           {comparison.trees}, {comparison.unmatched} missing or too many"
    for each in comparison.quantities:
        outside = f", {each.outside} of {each.values} by more" if each.outside else ""
        share = (
            f" and {100 * each.allowed_share:g} % of its longer side" if each.allowed_share else ""
        )
        yield (
            f"{each.name:15} 95 % within {each.p95:.3g}{each.unit}, largest {each.largest:.3g}"
            f"{each.unit}, {each.allowed:g}{each.unit}{share} allowed{outside}"
        )
    if comparison.passed:
        yield "passed: it finds the kit's trees"
        return
    yield from comparison.problems[:_MOST_LINES]
    if len(comparison.problems) > _MOST_LINES:
        yield f"and {len(comparison.problems) - _MOST_LINES} more, see --json"
    yield f"failed: {counted(len(comparison.problems), 'difference')}"
