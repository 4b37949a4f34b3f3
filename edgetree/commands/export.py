"""`edgetree export`: export a checkpoint to ONNX and check that it finds the same trees."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from basetree.errors import InputError
from basetree.program.console import complain, note, print_json, tell, tell_words
from basetree.program.options import expand_groups
from basetree.program.progress import steps_shown
from basetree.program.quoting import quoted
from edgetree.commands.options import Json
from edgetree.export.settings import ExportSettings

if TYPE_CHECKING:
    from edgetree.export import ExportReport


@expand_groups
def export(
    checkpoint: Annotated[
        Path, typer.Argument(metavar="CKPT", help="A checkpoint of `perceptree train`.")
    ],
    out: Annotated[Path, typer.Option(help="The .onnx file to write.")],
    data: Annotated[
        Path,
        typer.Option(
            help="Folder of real frames, or a dataset or its label file, to compare file and model"
            " on."
        ),
    ],
    *,
    settings: ExportSettings,
    calibration: Annotated[
        Path | None,
        typer.Option(
            help="Folder of frames to calibrate fp16 and int8 on.", show_default="that of --data"
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Export a checkpoint to ONNX. The file is written only if it finds the same trees.

    Options that are not given are taken from the checkpoint.
    """
    check_inputs(checkpoint, data, data if calibration is None else calibration)
    from edgetree.export import export_model

    with showing_differences(), steps_shown("reading the checkpoint") as say:
        report = export_model(
            checkpoint, out, data=data, settings=settings, calibration=calibration, say=say
        )
    _tell(report, as_json)


def _tell(report: ExportReport, as_json: bool) -> None:
    if as_json:
        print_json(record(report))
        return
    for line in report.parity.table().splitlines():
        tell_words(line)
    tell(f"{report.path} ({report.file_bytes / 1e6:.1f} MB, {report.manifest.precision})")
    note(f"next: edgetree bench {quoted(report.path)}", whole=True)


def check_inputs(checkpoint: Path, *folders: Path) -> None:
    """Check that files and folders exist, before PyTorch is loaded, which takes seconds.

    Args:
        checkpoint: The checkpoint.
        folders: Folders of frames, or datasets.

    Raises:
        InputError: One of them does not exist, or is of another kind.
    """
    if not checkpoint.exists():
        raise InputError(f"{checkpoint}: no such file, expected a .safetensors checkpoint")
    if checkpoint.suffix == ".onnx":
        raise InputError(
            f"{checkpoint}: is an exported model, expected its .safetensors checkpoint"
        )
    for folder in folders:
        if not (folder.is_dir() or (folder.is_file() and folder.suffix == ".json")):
            raise InputError(
                f"{folder} is no folder: expected one with frames, or a dataset or its label file"
            )


@contextmanager
def showing_differences() -> Iterator[None]:
    """If a parity check fails, print the differences before the error."""
    from edgetree.export import ParityFailed

    try:
        yield
    except ParityFailed as error:
        for line in error.report.table().splitlines():
            complain(line, whole=True)
        raise


def record(report: ExportReport) -> dict[str, Any]:
    """The result of an export or a verification as one JSON object."""
    manifest = report.manifest
    return {
        "schema": "edgetree.export/1",
        "model": str(report.path),
        "name": manifest.name,
        "modality": manifest.modality,
        "precision": manifest.precision,
        "provider": manifest.target,
        "input_px": [manifest.input.width, manifest.input.height],
        "batch": manifest.input.batch_sizes[0],
        "proposals": manifest.proposals,
        "opset": manifest.opset,
        "multiply_adds": manifest.multiply_adds,
        "parameters": manifest.parameters,
        "file_bytes": report.file_bytes,
        "weights_sha256": manifest.weights_sha256,
        "parity": report.parity.figures(),
    }
