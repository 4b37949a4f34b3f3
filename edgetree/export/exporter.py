"""From a checkpoint to one file that describes itself and is proven to equal it."""

from __future__ import annotations

import hashlib
import importlib.metadata
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from edgetree.errors import InputError, MissingDependency
from edgetree.export.frames import (
    InputRules,
    find_frames,
    frames_sha256,
    probe_frames,
    read_frames,
)
from edgetree.export.graph import OPSET, trace
from edgetree.export.parity import (
    Arrays,
    ParityFailed,
    ParityReport,
    compare_frames,
    limits_of,
)
from edgetree.export.quantise import quantise
from edgetree.manifest import (
    METADATA_KEY,
    Manifest,
    ResizeRule,
    Thresholds,
    standard_input,
    standard_outputs,
)
from edgetree.outputs import replacing
from edgetree.runtime import TreeDetector
from edgetree.session import InferenceSession, OrtSession

if TYPE_CHECKING:
    from perceptree.models import ModelSpec, TreeRCNN

__all__ = ["PRECISIONS", "ExportReport", "export_model", "verify_model"]

PRECISIONS: Final = {"fp32": "float32", "int8": "int8"}
PARITY_FRAMES: Final = 20
CALIBRATION_FRAMES: Final = 64
AP_FRAMES: Final = 100
AP_LIMIT: Final = 1.0

Say = Callable[[str], None]


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
    precision: str = "fp32",
    calibration: Path | None = None,
    say: Say = _silent,
) -> ExportReport:
    """Write a checkpoint as an ONNX file, if the file finds what the checkpoint finds.

    Args:
        checkpoint: a perceptree checkpoint.
        out: the file to write; untouched unless everything went well.
        data: folder with the frames to compare on (and, as a data set with labels, for AP).
        precision: ``fp32`` or ``int8``.
        calibration: folder with the frames that INT8 ranges are taken from; ``data`` if None,
            without the frames compared on.
        say: told what is being done.

    Raises:
        InputError: a folder or value that cannot be used.
        CheckpointError: the checkpoint cannot be read.
        ParityFailed: the file differs from the checkpoint by more than the limits.
    """
    if precision not in PRECISIONS:
        raise InputError(f"precision is {precision!r}: expected one of {', '.join(PRECISIONS)}")
    with replacing(out) as beside:
        model, record = _load(checkpoint)
        rules = InputRules.of(model.spec)
        compared = find_frames(data, rules.modality, PARITY_FRAMES, unseen=True)
        manifest = _manifest(model, record, PRECISIONS[precision])
        shown = None
        if precision == "int8":
            shown = _calibration_frames(calibration or data, compared, rules)
            manifest = replace(manifest, calibration_sha256=frames_sha256(shown))
        say("tracing the graph")
        proto = trace(model, batch=1)
        if shown is not None:
            say(f"quantising on {len(shown)} frames")
            proto = quantise(proto, shown)
        _strip(proto)
        with _session_of(_with_manifest(proto, manifest)) as session:
            parity = _prove(model, session, manifest, compared, data, say)
        manifest = replace(manifest, parity=parity.figures())
        beside.write_bytes(_with_manifest(proto, manifest).SerializeToString())
        size = beside.stat().st_size
    return ExportReport(out, manifest, parity, size)


def verify_model(file: Path, checkpoint: Path, *, data: Path, say: Say = _silent) -> ExportReport:
    """Hold an exported file against its checkpoint, on frames of ``data``.

    Raises as ``export_model`` does, and ModelFileError for a file that is none of ours.
    """
    session = OrtSession(file)
    manifest = TreeDetector(session).manifest
    model, _ = _load(checkpoint)
    _check_same_model(file, manifest, model)
    compared = find_frames(data, manifest.modality, PARITY_FRAMES, unseen=True)
    parity = _prove(model, session, manifest, compared, data, say)
    return ExportReport(file, manifest, parity, file.stat().st_size)


def _load(checkpoint: Path) -> tuple[TreeRCNN, dict[str, Any]]:
    try:
        import onnx  # noqa: F401
        import onnxscript  # noqa: F401

        from perceptree.models import load_checkpoint
    except ImportError as error:
        raise MissingDependency(
            f"{error.name} is not installed: install edgetree[cpu,train,export]"
        ) from error
    return load_checkpoint(checkpoint)


def _check_same_model(file: Path, manifest: Manifest, model: TreeRCNN) -> None:
    size = (manifest.input.height, manifest.input.width)
    if manifest.modality != model.spec.modality or size != (model.spec.height, model.spec.width):
        raise InputError(
            f"{file} takes {manifest.modality} frames of {manifest.input.size_text} px:"
            f" expected {model.spec.modality} of {model.spec.width}x{model.spec.height},"
            " as the checkpoint"
        )


def _calibration_frames(folder: Path, compared: list[Path], rules: InputRules) -> NDArray[np.uint8]:
    taken = {path.resolve() for path in compared}
    found = find_frames(folder, rules.modality, CALIBRATION_FRAMES + len(taken))
    paths = [path for path in found if path.resolve() not in taken][:CALIBRATION_FRAMES]
    if not paths:
        raise InputError(
            f"folder {folder} has no frames beside those compared on: expected some to calibrate on"
        )
    return read_frames(paths, rules)


def _prove(
    model: TreeRCNN,
    session: InferenceSession,
    manifest: Manifest,
    paths: list[Path],
    data: Path,
    say: Say,
) -> ParityReport:
    rules = InputRules.of(model.spec)
    images = read_frames(paths, rules)
    names = (path.stem for path in paths)
    frames = dict(zip(names, images, strict=True)) | probe_frames(rules, images)
    say(f"comparing on {len(frames)} frames")
    limits = limits_of(manifest.precision)
    shown = compare_frames(
        lambda image: _answer(model, manifest, image),
        lambda image: session.run({manifest.input.name: image}),
        frames,
        manifest.precision,
        manifest.thresholds.score,
    )
    report = ParityReport(manifest.precision, shown, limits=limits)
    if manifest.precision != "float32":
        report = _with_average_precision(report, model, session, manifest, data, say)
    faults = report.faults()
    if faults:
        more = f" and {len(faults) - 2} more" if len(faults) > 2 else ""
        raise ParityFailed(
            f"the file does not find what the checkpoint finds: {'; '.join(faults[:2])}{more}",
            report,
        )
    return report


def _answer(model: TreeRCNN, manifest: Manifest, image: NDArray[np.uint8]) -> Arrays:
    import torch

    with torch.inference_mode():
        found = model.detect(torch.from_numpy(image))._asdict()
    return {name: found[name].numpy() for name in manifest.output_names}


def _with_average_precision(
    report: ParityReport,
    model: TreeRCNN,
    session: InferenceSession,
    manifest: Manifest,
    data: Path,
    say: Say,
) -> ParityReport:
    """The report with the box AP of both, where ``data`` has labels of frames not trained on."""
    from perceptree.data import FrameStore, read_split
    from perceptree.evaluation import RawDetections, evaluate, predict_with

    split = next((name for name in ("test", "val") if _labels(data, name).is_file()), None)
    if split is None:
        return report
    store = FrameStore(read_split(data, split)[:AP_FRAMES], model.spec)
    say(f"evaluating on {len(store)} labelled frames")

    def predict(images: NDArray[np.uint8]) -> RawDetections:
        found = session.run({manifest.input.name: images})
        return RawDetections(
            found["boxes"],
            found["scores"],
            found.get("keypoints"),
            found.get("masks"),
            found["num_detections"],
        )

    before = evaluate(predict_with(model), store).box_ap
    after = evaluate(predict, store).box_ap
    return replace(report, ap_model=round(before, 3), ap_file=round(after, 3), ap_limit=AP_LIMIT)


def _labels(data: Path, split: str) -> Path:
    return data / f"{split}_RGB.json"


def _manifest(model: TreeRCNN, record: dict[str, Any], precision: str) -> Manifest:
    from perceptree.models import CLASS_NAMES, KEYPOINT_FLIP_PAIRS, KEYPOINT_NAMES

    spec: ModelSpec = model.spec
    return Manifest(
        name=spec.name,
        backbone=spec.backbone,
        modality=spec.modality,
        input=standard_input(spec.modality, spec.height, spec.width),
        resize=ResizeRule(pad_value=spec.pad_value),
        mean=spec.mean,
        std=spec.std,
        depth_encoding=spec.depth_encoding,
        outputs=standard_outputs(spec.detections, keypoints=spec.keypoints, masks=spec.masks),
        classes=CLASS_NAMES,
        keypoint_names=KEYPOINT_NAMES if spec.keypoints else (),
        keypoint_flip_pairs=KEYPOINT_FLIP_PAIRS if spec.keypoints else (),
        thresholds=Thresholds(spec.score_threshold, spec.nms_iou),
        precision=precision,
        opset=OPSET,
        parameters=sum(value.numel() for value in model.parameters()),
        weights_sha256=_weights_sha256(model),
        training_data=str(record.get("training", {}).get("data", "unknown")),
        project_version=_version(),
    )


def _weights_sha256(model: TreeRCNN) -> str:
    """Hash of all weights' names and values, whatever their layout in memory."""
    digest = hashlib.sha256()
    for name, value in sorted(model.state_dict().items()):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(value.numpy()).tobytes())
    return digest.hexdigest()


def _version() -> str:
    try:
        return importlib.metadata.version("edgetree")
    except importlib.metadata.PackageNotFoundError:
        return "unknown"


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
