"""The schemas by the names that JSON objects give in `schema`."""

from __future__ import annotations

from typing import Any, Final

from basetree.schemas import schema_of
from calib.schemas import FoundLabels
from edgetree.bench.result import SCHEMA as BENCH_SCHEMA
from edgetree.conformance.kit import KIT_SCHEMA, Kit
from edgetree.conformance.results import RESULTS_SCHEMA, Results
from edgetree.live.page.records import PAGE_SCHEMA
from edgetree.live.recording import RECORDING_SCHEMA
from edgetree.model_file.card import CARD_SCHEMA
from edgetree.model_file.manifest import SCHEMA as MANIFEST_SCHEMA
from edgetree.model_file.manifest import Manifest
from edgetree.schemas import bench, card, commands, files, page, reports, results
from edgetree.serve import messages

_TYPES: Final[dict[str, Any]] = {
    "calib.camera/1": commands.CameraFile,
    "calib.depth_scale/1": commands.DepthScaleFile,
    "calib.found-labels/1": FoundLabels,
    "calib.stereo/1": commands.StereoFile,
    "calib.transform/1": commands.TransformFile,
    BENCH_SCHEMA: bench.Bench,
    "edgetree.bench-comparison/1": reports.BenchComparison,
    "edgetree.calibrate/1": reports.Calibrate,
    CARD_SCHEMA: card.Card,
    "edgetree.check/1": commands.Check,
    "edgetree.check-rig/1": reports.CheckRig,
    "edgetree.check_settings/1": commands.CheckSettings,
    "edgetree.conformance-check/1": reports.ConformanceCheck,
    "edgetree.conformance-make/1": reports.ConformanceMake,
    KIT_SCHEMA: Kit,
    RESULTS_SCHEMA: Results,
    "edgetree.demo/1": reports.Demo,
    "edgetree.doctor/1": reports.Doctor,
    "edgetree.export/1": reports.Export,
    "edgetree.frame/1": results.Frame,
    "edgetree.job/1": files.Job,
    "edgetree.live/1": results.Live,
    "edgetree.live.map/1": results.StemMap,
    PAGE_SCHEMA: page.Page,
    "edgetree.live.state/1": files.State,
    "edgetree.live.stems/1": results.Stems,
    MANIFEST_SCHEMA: Manifest,
    "edgetree.measure/1": commands.Measure,
    "edgetree.merge/1": commands.Merge,
    "edgetree.model-signature/1": files.ModelSignature,
    "edgetree.models/1": commands.Models,
    "edgetree.part/1": files.Part,
    RECORDING_SCHEMA: files.Recording,
    "edgetree.recording.frame/1": files.RecordingFrame,
    "edgetree.run/1": commands.Run,
    "edgetree.serve.ask/1": messages.AskMessage,
    "edgetree.serve.bye/1": messages.ByeMessage,
    "edgetree.serve.error/1": messages.ErrorAnswer,
    "edgetree.serve.frame/1": messages.FrameMessage,
    "edgetree.serve.result/1": messages.ResultAnswer,
    "edgetree.serve.status/1": messages.StatusAnswer,
    "edgetree.serve.unused/1": messages.UnusedAnswer,
    "edgetree.serve.watch/1": messages.WatchMessage,
    "edgetree.shard/1": files.Shard,
    "edgetree.signature-file/1": files.SignatureFile,
    "edgetree.trust/1": files.Trust,
    "edgetree.used-versions/1": files.UsedVersions,
    "edgetree.written-shard/1": files.WrittenShard,
}


def schema_names() -> tuple[str, ...]:
    """The names of all schemas."""
    return tuple(sorted(_TYPES))


def json_schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a format.

    Fields of newer versions are allowed, as the programs of this project allow them.

    Args:
        name: Such as "edgetree.frame/1"; without its number, the newest one.

    Raises:
        InputError: There is no such schema.
    """
    return schema_of(_TYPES, name, {"perceptree": "perceptree schema"})
