"""`edgetree export`: a trained checkpoint as one file that is proven to find the same trees."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from edgetree.commands.options import Json
from edgetree.console import note, print_json

if TYPE_CHECKING:
    from edgetree.export import ExportReport

__all__ = ["export", "record", "showing_differences"]


def export(
    checkpoint: Annotated[
        Path, typer.Argument(metavar="CKPT", help="A checkpoint of `perceptree train`.")
    ],
    out: Annotated[Path, typer.Option(help="The .onnx file to write.")],
    data: Annotated[
        Path,
        typer.Option(help="Folder with real frames, or a data set, to compare file and model on."),
    ],
    precision: Annotated[str, typer.Option(help="fp32, or int8 for CPUs.")] = "fp32",
    calibration: Annotated[
        Path | None,
        typer.Option(help="Folder with frames to take int8 ranges from; --data if not given."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Export a checkpoint to ONNX. A file that finds other trees than its model is not written."""
    from edgetree.export import export_model

    with showing_differences():
        report = export_model(
            checkpoint, out, data=data, precision=precision, calibration=calibration, say=note
        )
    if as_json:
        print_json(record(report))
        return
    typer.echo(report.parity.table())
    typer.echo(f"{report.path} ({report.file_bytes / 1e6:.1f} MB, {report.manifest.precision})")
    note(f"next: edgetree run IMAGE --model {report.path} --out pictures")


@contextmanager
def showing_differences() -> Iterator[None]:
    """Show where a file and its model differ, if they do, and let the error pass."""
    from edgetree.export import ParityFailed

    try:
        yield
    except ParityFailed as error:
        note(error.report.table())
        raise


def record(report: ExportReport) -> dict[str, Any]:
    """An export or a verification as one JSON object."""
    manifest = report.manifest
    return {
        "schema": "edgetree.export/1",
        "model": str(report.path),
        "name": manifest.name,
        "modality": manifest.modality,
        "precision": manifest.precision,
        "parameters": manifest.parameters,
        "file_bytes": report.file_bytes,
        "weights_sha256": manifest.weights_sha256,
        "parity": report.parity.figures(),
    }
