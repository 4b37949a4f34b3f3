"""`edgetree export`: export a checkpoint to ONNX and check that it finds the same trees."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

import typer

from basetree.program.console import note, print_json
from edgetree.commands.options import Json

if TYPE_CHECKING:
    from edgetree.export import ExportReport

__all__ = ["export", "record", "showing_differences"]


Data: TypeAlias = Annotated[
    Path, typer.Option(help="Folder of real frames, or a dataset, to compare file and model on.")
]
Precision: TypeAlias = Annotated[
    str, typer.Option(help="fp32; fp16 for GPUs; int8 for CPUs, OpenVINO and TensorRT.")
]
Calibration: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Folder of frames to calibrate fp16 and int8 on; --data if not given."),
]
Side: TypeAlias = Annotated[int | None, typer.Option(help="Size of the input in px.")]
Batch: TypeAlias = Annotated[int, typer.Option(help="Frames per inference.")]
Rows: TypeAlias = Annotated[int | None, typer.Option(help="Number of rows of each output.")]
Proposals: TypeAlias = Annotated[int | None, typer.Option(help="Region proposals per frame.")]
Lowest: TypeAlias = Annotated[float | None, typer.Option(help="Lowest score in the outputs.")]
Opset: TypeAlias = Annotated[int, typer.Option(help="ONNX operator set, 18 to 23.")]
Provider: TypeAlias = Annotated[
    str,
    typer.Option(help="Target provider: cpu, cuda, tensorrt, openvino, coreml or directml."),
]


def export(
    checkpoint: Annotated[
        Path, typer.Argument(metavar="CKPT", help="A checkpoint of `perceptree train`.")
    ],
    out: Annotated[Path, typer.Option(help="The .onnx file to write.")],
    data: Data,
    precision: Precision = "fp32",
    calibration: Calibration = None,
    height: Side = None,
    width: Side = None,
    batch: Batch = 1,
    max_detections: Rows = None,
    proposals: Proposals = None,
    score_threshold: Lowest = None,
    opset: Opset = 20,
    provider: Provider = "cpu",
    as_json: Json = False,
) -> None:
    """Export a checkpoint to ONNX. The file is written only if it finds the same trees.

    Options that are not given are taken from the checkpoint.
    """
    from edgetree.export import ExportSettings, export_model

    settings = ExportSettings(
        height=height,
        width=width,
        batch=batch,
        max_detections=max_detections,
        proposals=proposals,
        precision=precision,
        score_threshold=score_threshold,
        opset=opset,
        target=provider,
    )
    with showing_differences():
        report = export_model(
            checkpoint, out, data=data, settings=settings, calibration=calibration, say=note
        )
    _tell(report, as_json)


def _tell(report: ExportReport, as_json: bool) -> None:
    if as_json:
        print_json(record(report))
        return
    typer.echo(report.parity.table())
    typer.echo(f"{report.path} ({report.file_bytes / 1e6:.1f} MB, {report.manifest.precision})")
    note(f"next: edgetree run IMAGE --model {report.path} --out pictures")


@contextmanager
def showing_differences() -> Iterator[None]:
    """If a parity check fails, print the differences before the error."""
    from edgetree.export import ParityFailed

    try:
        yield
    except ParityFailed as error:
        note(error.report.table())
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
