"""Export a checkpoint or a preset to an ONNX file, in three steps: build, verify, write."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO

from basetree.errors import InputError
from basetree.files.writing import output_folder, replacing
from edgetree.export.build import ExportSource, build, with_manifest
from edgetree.export.frames import read_calibration_frames, sample_inputs
from edgetree.export.models import (
    UNTRAINED,
    load_model,
    pictures_of,
    settings_from_manifest,
    untrained_model,
    with_settings,
)
from edgetree.export.parity import ParityReport
from edgetree.export.settings import ExportSettings
from edgetree.export.verification import (
    Say,
    VerificationFrames,
    read_verification_frames,
    verify,
)
from edgetree.model_file.inputs_outputs import COLOUR, DEPTH
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.alone_session import AloneSession
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import InferenceSession, OrtSession


@dataclass(frozen=True)
class ExportReport:
    """Result of an export or a verification.

    Attributes:
        path: The ONNX file.
        manifest: Metadata in the file.
        parity: Comparison of the file with its model.
        file_bytes: Size of the file.
    """

    path: Path
    manifest: Manifest
    parity: ParityReport
    file_bytes: int


def _silent(_: str) -> None:
    return


def export_model(
    checkpoint: Path,
    out: Path,
    *,
    data: Path,
    settings: ExportSettings | None = None,
    calibration: Path | None = None,
    say: Say = _silent,
) -> ExportReport:
    """Export a checkpoint to an ONNX file, and verify that both give the same detections.

    Args:
        checkpoint: a perceptree checkpoint.
        out: The file to write. It is not changed unless the export succeeds.
        data: Folder with frames to compare on. If it is a labelled dataset, average precision
            is compared too, for `int8` and `fp16`; otherwise the report says that it was not.
        settings: Precision, input size and other options.
        calibration: Folder with frames for the ranges of activations, for `int8` and `fp16`.
            By default `data`, without the frames to compare on.
        say: Called with progress messages.

    Returns:
        The file with its manifest and the comparison.

    Raises:
        InputError: a folder or value cannot be used.
        CheckpointError: The checkpoint cannot be read.
        ParityFailed: The file differs from the checkpoint by more than the limits.
    """
    settings = settings or ExportSettings()
    with _new_onnx_file(out) as file:
        loaded, training_data, usual, reach_m = load_model(checkpoint)
        model = with_settings(loaded, settings)
        frames = read_verification_frames(data, model.spec)
        calibration_frames = None
        if settings.precision != "fp32":
            calibration_frames = read_calibration_frames(
                calibration or data, model.spec, exclude=frames.paths
            )
        pictures = pictures_of(model, usual)
        source = ExportSource(model, training_data, calibration_frames, pictures, reach_m)
        return _build_verify_write(source, settings, frames, file, out, say)


def export_preset(
    preset: str,
    out: Path,
    *,
    modality: str = "rgb",
    settings: ExportSettings | None = None,
    say: Say = _silent,
) -> ExportReport:
    """Export a preset with untrained weights, for measuring speed and cost.

    It is verified on the sample frames of the package.

    Args:
        preset: Name of the preset.
        out: The file to write. It is not changed unless the export succeeds.
        modality: `rgb`, `depth` or `both`.
        settings: Precision, input size and other options.
        say: Called with progress messages.

    Returns:
        The file with its manifest and the comparison.

    Raises:
        InputError: a value cannot be used.
        SpecError: The preset is unknown.
        ParityFailed: The file differs from the model by more than the limits.
    """
    settings = settings or ExportSettings()
    with _new_onnx_file(out) as file:
        model = untrained_model(preset, modality, settings)
        images = sample_inputs(model.spec)
        half = len(images) // 2
        named = {f"sample {number}": image for number, image in enumerate(images[:half])}
        source = ExportSource(model, UNTRAINED, images[half:])
        verification = VerificationFrames(named)
        report = _build_verify_write(source, settings, verification, file, out, say, trained=False)
        for line in report.parity.not_checked:
            say(line)
        return report


def verify_model(file: Path, checkpoint: Path, *, data: Path, say: Say = _silent) -> ExportReport:
    """Verify that an exported file and its checkpoint give the same detections.

    The limits are those of a trained network, whatever the file says of its training data.

    Args:
        file: An ONNX file from `export_model`.
        checkpoint: The checkpoint that it was made from; of a combined file one of the three, and
            then the part of the file that it was made from is compared.
        data: Folder with frames to compare on, see `export_model`.
        say: Called with progress messages.

    Returns:
        The file with its manifest and the comparison.

    Raises:
        InputError: a folder cannot be used, or file and checkpoint have different modalities.
        ModelFileError: The file is not a model file of this project.
        CheckpointError: The checkpoint cannot be read.
        ParityFailed: The file differs from the checkpoint by more than the limits.
    """
    session: InferenceSession = OrtSession(file)
    manifest = TreeDetector(session).manifest
    model, *_ = load_model(checkpoint)
    shown = {"rgb": COLOUR, "depth": DEPTH}.get(model.spec.modality)
    if manifest.alone and shown is not None:
        session, manifest = AloneSession(session, manifest, shown), manifest.alone[shown]
    if model.spec.modality not in (manifest.modality, "both"):
        raise InputError(
            f"{file} takes {manifest.modality} frames: expected {model.spec.modality} frames,"
            f" as {checkpoint}"
        )
    model = with_settings(model, settings_from_manifest(manifest))
    frames = read_verification_frames(data, model.spec)
    parity = verify(model, session, manifest, frames, say)
    return ExportReport(file, manifest, parity, file.stat().st_size)


@contextmanager
def _new_onnx_file(out: Path) -> Iterator[BinaryIO]:
    """A temporary file that becomes `out` if the block succeeds."""
    if out.suffix.lower() != ".onnx":
        raise InputError(f"the file to write is {out}: expected a name that ends in .onnx")
    with output_folder(out.parent), replacing(out) as file:
        yield file


def _build_verify_write(
    source: ExportSource,
    settings: ExportSettings,
    frames: VerificationFrames,
    file: BinaryIO,
    path: Path,
    say: Say,
    *,
    trained: bool = True,
) -> ExportReport:
    """Build and verify a model, and write it to a file that becomes `path`."""
    built = build(source, settings, say)
    session, model = built.session(), source.model
    parity = verify(model, session, built.manifest, frames, say, trained=trained)
    manifest = replace(built.manifest, parity=parity.figures())
    content = with_manifest(built.proto, manifest)
    file.write(content)
    return ExportReport(path, manifest, parity, len(content))
