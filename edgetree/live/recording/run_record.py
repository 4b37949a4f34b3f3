"""What a recording says about the run: model, rig and settings."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

from calib import RigidTransform
from edgetree.frames.rig import Rig
from edgetree.measure import MeasureSettings

__all__ = ["RECORDING_SCHEMA", "run_record"]

RECORDING_SCHEMA: Final = "edgetree.recording/1"


def run_record(
    model: Path,
    *,
    source: str,
    score_threshold: float,
    rig: Rig,
    settings: MeasureSettings | None = None,
) -> dict[str, Any]:
    """What is needed beside the frames to reproduce a result, as a JSON object.

    Args:
        model: the model file.
        source: what the frames come from.
        score_threshold: lowest score of trees.
        rig: the cameras.
        settings: settings of the measurement; the defaults if None.

    Raises:
        OSError: the model file cannot be read.
    """
    with model.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return {
        "schema": RECORDING_SCHEMA,
        "edgetree": version("edgetree"),
        "source": source,
        "model": {"file": model.name, "sha256": digest},
        "score_threshold": score_threshold,
        "rig": {
            "camera": None if rig.camera is None else rig.camera.to_dict(),
            "up_camera": rig.up_camera,
            "mounting": None if rig.mounting is None else _transform(rig.mounting),
        },
        "measure": asdict(settings or MeasureSettings()),
    }


def _transform(transform: RigidTransform) -> dict[str, Any]:
    return {
        "rotation": transform.rotation.tolist(),
        "translation_m": transform.translation_m.tolist(),
    }
