"""The schemas by name. Files of other programs' forms, such as COCO, have no key `schema`."""

from __future__ import annotations

from typing import Any, Final

from basetree.schemas import schema_of
from perceptree.schemas import datasets, evaluation, tables, training

_TYPES: Final[dict[str, Any]] = {
    "perceptree.checkpoint/1": training.Checkpoint,
    "perceptree.data-check/1": datasets.DataCheck,
    "perceptree.data-compare/1": datasets.DataCompare,
    "perceptree.data-settings/1": datasets.DataSettings,
    "perceptree.data-written/1": datasets.DataWritten,
    "perceptree.evaluation/1": evaluation.Evaluation,
    "perceptree.frozen-set/1": datasets.FrozenSet,
    "perceptree.import/1": training.Import,
    "perceptree.labels/2": datasets.Labels,
    "perceptree.predict/1": evaluation.Predict,
    "perceptree.predictions/1": evaluation.Predictions,
    "perceptree.scene-frames/1": datasets.SceneFrames,
    "perceptree.statistics/1": datasets.Statistics,
    "perceptree.synth/1": datasets.Synth,
    "perceptree.synth-settings/2": datasets.SynthSettings,
    "perceptree.table/1": tables.PrintedTable,
    "perceptree.table-run/1": tables.TableRun,
    "perceptree.tables/1": tables.Tables,
    "perceptree.train/1": training.Train,
    "perceptree.training-log/1": training.LogLine,
}


def schema_names() -> tuple[str, ...]:
    """The names of all schemas."""
    return tuple(sorted(_TYPES))


def json_schema(name: str) -> dict[str, Any]:
    """The JSON Schema of a format.

    Fields of newer versions are allowed.

    Args:
        name: Such as "perceptree.evaluation/1"; without its number, the newest one.

    Raises:
        InputError: There is no such schema.
    """
    command = "edgetree schema"
    return schema_of(_TYPES, name, {"edgetree": command, "calib": command})
