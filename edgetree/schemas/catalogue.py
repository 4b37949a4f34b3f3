"""The schemas by the names that JSON objects give in `schema`."""

from __future__ import annotations

from typing import Any, Final

import msgspec

from basetree.errors import InputError
from edgetree.conformance.kit import KIT_SCHEMA, Kit
from edgetree.conformance.results import RESULTS_SCHEMA, Results
from edgetree.model_file.manifest import SCHEMA as MANIFEST_SCHEMA
from edgetree.model_file.manifest import Manifest
from edgetree.schemas import commands, files, reports, results
from edgetree.serve import messages

_DRAFT: Final = "https://json-schema.org/draft/2020-12/schema"
_TYPES: Final[dict[str, Any]] = {
    "calib.camera/1": commands.CameraFile,
    "calib.depth_scale/1": commands.DepthScaleFile,
    "calib.stereo/1": commands.StereoFile,
    "calib.transform/1": commands.TransformFile,
    "edgetree.bench-comparison/1": reports.BenchComparison,
    "edgetree.calibrate/1": reports.Calibrate,
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
    "edgetree.live.state/1": files.State,
    "edgetree.live.stems/1": results.Stems,
    MANIFEST_SCHEMA: Manifest,
    "edgetree.measure/1": commands.Measure,
    "edgetree.merge/1": commands.Merge,
    "edgetree.model-signature/1": files.ModelSignature,
    "edgetree.models/1": commands.Models,
    "edgetree.part/1": files.Part,
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
    "edgetree.trust/1": files.Trust,
    "edgetree.used-versions/1": files.UsedVersions,
}


def schema_names() -> tuple[str, ...]:
    """The names of all schemas."""
    return tuple(sorted(_TYPES))


def json_schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a format.

    Fields of newer versions are allowed, as the programs of this project allow them.

    Args:
        name: Such as "edgetree.frame/1"; the number may be left out.

    Raises:
        InputError: There is no such schema.
    """
    full = name if name in _TYPES else f"{name}/1"
    if full not in _TYPES:
        raise InputError(f"schema {name!r} is unknown: expected one of {', '.join(schema_names())}")
    made = msgspec.json.schema(_TYPES[full])
    return {"$schema": _DRAFT, "title": full, **made}
