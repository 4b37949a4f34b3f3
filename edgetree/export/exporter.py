"""From a checkpoint to one file that describes itself and is proven to equal it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.errors import InputError
from edgetree.export.describe import describe
from edgetree.export.frames import (
    InputRules,
    find_frames,
    frames_sha256,
    read_frames,
    sample_inputs,
)
from edgetree.export.graph import trace
from edgetree.export.half import halve
from edgetree.export.parity import ParityReport
from edgetree.export.prepare import (
    UNTRAINED,
    load_model,
    settings_of,
    untrained_model,
    with_settings,
)
from edgetree.export.proving import Evidence, Say, evidence_in, prove
from edgetree.export.quantise import quantise
from edgetree.export.settings import ExportSettings
from edgetree.model_file.manifest import METADATA_KEY, Manifest
from edgetree.results.atomic_files import output_folder, replacing
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import InferenceSession, OrtSession

if TYPE_CHECKING:
    from perceptree.models import TreeRCNN

__all__ = ["ExportReport", "export_model", "export_preset", "verify_model"]

CALIBRATION_FRAMES: Final = 64


@dataclass(frozen=True)
class ExportReport:
    """A file, its manifest, and the proof."""

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
    """Write a checkpoint as an ONNX file, if the file finds what the checkpoint finds.

    Args:
        checkpoint: a perceptree checkpoint.
        out: the file to write; untouched unless everything went well.
        data: folder with the frames to compare on (and, as a data set with labels, for AP).
        settings: what the file is to be.
        calibration: folder with the frames that show the range of activations, for ``int8`` and
            ``fp16``; ``data`` if None, without the frames compared on.
        say: told what is being done.

    Raises:
        InputError: a folder or value that cannot be used.
        CheckpointError: the checkpoint cannot be read.
        ParityFailed: the file differs from the checkpoint by more than the limits.
    """
    settings = settings or ExportSettings()
    _check_name(out)
    with output_folder(out.parent), replacing(out) as beside:
        loaded, training_data = load_model(checkpoint)
        model = with_settings(loaded, settings)
        rules = InputRules.of(model.spec)
        evidence = evidence_in(data, rules)
        shown = None
        if settings.precision != "fp32":
            shown = _calibration_frames(calibration or data, evidence.paths, rules)
        manifest = describe(model, training_data, settings)
        return _write(model, manifest, settings, evidence, shown, (beside, out), say)


def export_preset(
    preset: str,
    out: Path,
    *,
    modality: str = "rgb",
    settings: ExportSettings | None = None,
    say: Say = _silent,
) -> ExportReport:
    """Write a preset with untrained weights: its speed and cost are those of the trained one.

    It is proven as any export, on the package's sample frames. Arguments and errors otherwise as
    for ``export_model``.
    """
    settings = settings or ExportSettings()
    _check_name(out)
    with output_folder(out.parent), replacing(out) as beside:
        model = untrained_model(preset, modality, settings)
        images = sample_inputs(InputRules.of(model.spec))
        half = len(images) // 2
        frames = {f"sample {number}": image for number, image in enumerate(images[:half])}
        manifest = describe(model, UNTRAINED, settings)
        evidence = Evidence(frames, [], None)
        return _write(model, manifest, settings, evidence, images[half:], (beside, out), say)


def verify_model(file: Path, checkpoint: Path, *, data: Path, say: Say = _silent) -> ExportReport:
    """Hold an exported file against its checkpoint, on frames of ``data``.

    Raises as ``export_model`` does, and ModelFileError for a file that is none of ours.
    """
    session = OrtSession(file)
    manifest = TreeDetector(session).manifest
    model, _ = load_model(checkpoint)
    if manifest.modality != model.spec.modality:
        raise InputError(
            f"{file} takes {manifest.modality} frames: expected {model.spec.modality} ones,"
            f" as {checkpoint}"
        )
    model = with_settings(model, settings_of(manifest))
    evidence = evidence_in(data, InputRules.of(model.spec))
    parity = prove(model, session, manifest, evidence, say)
    return ExportReport(file, manifest, parity, file.stat().st_size)


def _check_name(out: Path) -> None:
    if out.suffix.lower() != ".onnx":
        raise InputError(f"the file to write is {out}: expected a name that ends in .onnx")


def _calibration_frames(folder: Path, compared: list[Path], rules: InputRules) -> NDArray[np.uint8]:
    taken = {path.resolve() for path in compared}
    found = find_frames(folder, rules.modality, CALIBRATION_FRAMES + len(taken))
    paths = [path for path in found if path.resolve() not in taken][:CALIBRATION_FRAMES]
    if not paths:
        raise InputError(
            f"folder {folder} has no frames beside those compared on: expected some to calibrate on"
        )
    return read_frames(paths, rules)


def _write(
    model: TreeRCNN,
    manifest: Manifest,
    settings: ExportSettings,
    evidence: Evidence,
    shown: NDArray[np.uint8] | None,
    paths: tuple[Path, Path],
    say: Say,
) -> ExportReport:
    """Make the graph, prove it, and write it beside the path that it is to have."""
    say("tracing the graph")
    proto = trace(model, settings.batch, settings.opset, quantised=settings.precision == "int8")
    if settings.precision != "fp32" and shown is not None:
        say(f"taking ranges from {len(shown)} frames")
        manifest = replace(manifest, calibration_sha256=frames_sha256(shown))
        if settings.precision == "int8":
            proto = quantise(proto, shown, symmetric=settings.target == "tensorrt")
        else:
            proto = halve(proto, shown)
    _strip(proto)
    with _session_of(_with_manifest(proto, manifest)) as session:
        parity = prove(model, session, manifest, evidence, say)
    manifest = replace(manifest, parity=parity.figures())
    beside, out = paths
    beside.write_bytes(_with_manifest(proto, manifest).SerializeToString())
    return ExportReport(out, manifest, parity, beside.stat().st_size)


def _strip(proto: Any) -> None:
    """Take out what the exporter notes for debugging, paths of this machine among it."""
    proto.doc_string = ""
    del proto.metadata_props[:]
    graph = proto.graph
    del graph.metadata_props[:]
    graph.doc_string = ""
    for items in (graph.node, graph.value_info, graph.input, graph.output, graph.initializer):
        for item in items:
            item.doc_string = ""
            del item.metadata_props[:]


def _with_manifest(proto: Any, manifest: Manifest) -> Any:
    import onnx

    onnx.helper.set_model_props(proto, {METADATA_KEY: manifest.to_json()})
    return proto


@contextmanager
def _session_of(proto: Any) -> Iterator[InferenceSession]:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.onnx"
        path.write_bytes(proto.SerializeToString())
        yield OrtSession(path)
