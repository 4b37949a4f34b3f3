"""One run of a table: train, evaluate on the test frames, store as `result.json`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from basetree.files.regular import read_regular
from basetree.files.writing import write_text
from perceptree.data import FrameStore
from perceptree.data.coco import FrameRecord
from perceptree.data.dataset import Dataset, read_dataset
from perceptree.data.layouts import find_labels
from perceptree.errors import CheckpointError, DatasetError
from perceptree.evaluation import evaluate, on_device, predict_with
from perceptree.models import ModelSpec, load_checkpoint
from perceptree.tables.plan import TableModel, TableSettings
from perceptree.training import Engine, Preparing, Status, TrainReport, train
from perceptree.training.starting import describe_init

RESULT_FILE = "result.json"
_SCHEMA = "perceptree.table-run/1"
_BATCH = 4

Result = dict[str, Any]


@dataclass(frozen=True)
class Watch:
    """Progress callbacks.

    Attributes:
        run: Called at the start of a run with its name, its number and the number of runs.
        training: Called with the status of a training.
        preparing: Callbacks while data are prepared.
        evaluating: Called with the number of frames evaluated and the total.
    """

    run: Callable[[str, int, int], None] = lambda name, number, total: None
    training: Callable[[Status], None] = lambda status: None
    preparing: Preparing = field(default_factory=Preparing)
    evaluating: Callable[[int, int], None] = lambda done, total: None


@dataclass(frozen=True, eq=False)
class TableData:
    """Data of a table.

    Attributes:
        folder: Folder of the training data.
        test_folder: Folder of the test data.
        test: The test frames.
        labels: SHA-256 of each split's label file.
    """

    folder: Path
    test_folder: Path
    test: list[FrameRecord]
    labels: dict[str, str]

    @classmethod
    def open(cls, folder: Path, test_folder: Path, preparing: Preparing) -> TableData:
        """Open the data.

        Raises:
            DatasetError: If label files are missing, or masks, keypoints or depth are incomplete.
        """
        _read_complete(folder, "train")
        test = _read_complete(test_folder, "test")
        for note in test.notes:
            preparing.say(f"{test.labels.path}: {note}")
        folders = {"train": folder, "val": folder, "test": test_folder}
        labels = {
            split: hashlib.sha256(find_labels(split_folder, split).path.read_bytes()).hexdigest()
            for split, split_folder in folders.items()
        }
        return cls(folder, test_folder, test.frames, labels)

    @property
    def test_identity(self) -> dict[str, Any]:
        """Identity of the test data, stored with a result."""
        return {"folder": _name(self.test_folder), "labels_sha256": self.labels["test"]}


def _read_complete(folder: Path, split: str) -> Dataset:
    found = read_dataset(folder, split)
    held = {
        "masks": found.has_masks,
        "keypoints": found.has_keypoints,
        "depth": found.has_depth,
    }
    missing = [name for name, there in held.items() if not there]
    if missing:
        raise DatasetError(
            f"{found.labels.path}: {' and '.join(missing)} missing or incomplete; expected masks,"
            " keypoints and depth for the tables"
        )
    return found


def _name(folder: Path) -> str:
    return folder.resolve().name


def make_result(
    settings: TableSettings,
    model: TableModel,
    seed: int,
    data: TableData,
    out: Path,
    engine: Engine,
    watch: Watch,
) -> Result:
    """Return the result of one run: the stored one, or a new one.

    An interrupted training is resumed.

    Args:
        settings: The table.
        model: Model of the run.
        seed: Seed of the run.
        data: Training and test data.
        out: Folder of the runs.
        engine: Device and precision.
        watch: Progress callbacks.

    Raises:
        CheckpointError: If the folder holds a run with other settings. `train` and `evaluate` may
            raise further errors.
    """
    folder = out / f"{model.name}-seed{seed}"
    spec = settings.spec(model)
    wanted = {
        "spec": spec.to_dict(),
        "settings": settings.training(model, seed).to_dict(),
        "init": describe_init(settings.start(model)),
        "data": {
            "folder": _name(data.folder),
            "train_labels_sha256": data.labels["train"],
            "val_labels_sha256": data.labels["val"],
        },
    }
    wanted = json.loads(json.dumps(wanted))
    known = read_result(folder / RESULT_FILE)
    if known is not None and known["training"] == wanted:
        if known["test"] == data.test_identity:
            return known
        result = {"schema": _SCHEMA, "training": wanted, "made": known["made"]}
    else:
        report = train(
            spec,
            settings.training(model, seed),
            data.folder,
            folder,
            watch.training,
            settings.start(model),
            engine,
            preparing=watch.preparing,
        )
        made = _training_facts(report)
        result = {"schema": _SCHEMA, "training": wanted, "made": made}
    metrics = _score(folder / "best.safetensors", data.test, engine.device, watch)
    result |= {"test": data.test_identity, "metrics": metrics}
    write_text(folder / RESULT_FILE, json.dumps(result, indent=1))
    return result


def _training_facts(report: TrainReport) -> dict[str, Any]:
    record = load_checkpoint(report.checkpoint)[1]["training"]
    return {
        "steps": report.steps,
        "elapsed_s": round(report.elapsed_s, 1),
        "frames": record["frames"],
        "precision": record["precision"],
        "device": record["device"],
        "val": report.metrics.to_dict(),
    }


def _score(
    checkpoint: Path, frames: list[FrameRecord], device: str, watch: Watch
) -> dict[str, Any]:
    model = on_device(load_checkpoint(checkpoint)[0], device)
    store, done = FrameStore(frames, model.spec), 0

    def report_progress(more: int) -> None:
        nonlocal done
        done += more
        watch.evaluating(done, len(store))

    return evaluate(predict_with(model), store, _BATCH, report_progress).to_dict()


def read_result(path: Path) -> Result | None:
    """Read the result of a run; None if there is no file.

    Raises:
        CheckpointError: If the file holds something else.
    """
    if not path.exists():
        return None
    try:
        result = json.loads(read_regular(path))
        if result["schema"] == _SCHEMA and {"training", "made", "test", "metrics"} <= set(result):
            return dict(result)
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        pass
    raise CheckpointError(
        f"{path}: not a result of a table's run, expected one; remove the file to repeat the run"
    )


def check_specs(settings: TableSettings) -> list[ModelSpec]:
    """Return the specs of all rows.

    Raises:
        SpecError: If a spec is invalid.
        SettingsError: If a starting checkpoint does not fit.
    """
    return [settings.spec(row.model) for row in settings.rows()]
