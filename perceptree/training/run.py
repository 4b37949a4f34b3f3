"""Run a training: start, resume, extend or branch it."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import Any

import torch

from basetree.errors import InputFileError, SettingsError
from basetree.files.locking import locked
from basetree.files.names import is_utf8
from perceptree.data.layouts import dataset_folder
from perceptree.errors import CheckpointError
from perceptree.models import ModelSpec, TreeRCNN
from perceptree.settings.training import EXTENDABLE_SETTINGS, DataSource, Engine, TrainSettings
from perceptree.training.counts import Counts, Progress
from perceptree.training.credits import Credits, joined_credits, training_credits
from perceptree.training.hardware import fastest_precision, keep_freed_memory
from perceptree.training.optimizer_state import check_optimizer_state
from perceptree.training.processes import Processes, process_group
from perceptree.training.source import Preparing, TrainingData, open_data
from perceptree.training.starting import (
    Init,
    describe_init,
    files_of,
    load_heads,
    start_from,
)
from perceptree.training.state import STATE_NAME, read_state, write_state
from perceptree.training.trainer import Trainer, TrainReport

# Settings that make no sense with a random backbone.
_NEED_START = ("frozen_norms", "frozen_steps", "keep_weights", "keep_features")
_CREDITS = "credits"  # in a state
_VAL_HASH = "val frames hash"
_MODEL = "model settings"


def train(
    spec: ModelSpec,
    settings: TrainSettings,
    data: Path | DataSource,
    out: Path,
    progress: Progress = lambda status: None,
    init: Init | None = None,
    engine: Engine | None = None,
    branch: Path | None = None,
    preparing: Preparing | None = None,
    heads: Path | None = None,
) -> TrainReport:
    """Train a model on the train split of a dataset and evaluate it on the val split.

    If `out` holds a `state.pt` with the same spec, settings, starting weights and data, the
    training is resumed. Unless its learning rate schedule depends on the end, a resumed training
    may have another end than before. Processes started by torchrun train on a joint batch.

    Args:
        spec: The model.
        settings: The training.
        data: Folder of the dataset, or a DataSource.
        out: Folder for the checkpoint, the state and the log.
        progress: Called with the status after every step.
        init: Starting weights; random if None.
        engine: Hardware and speed.
        branch: Folder of another run whose state to start from, step count included.
        preparing: Called with the progress of the preparation.
        heads: Checkpoint for all but the backbone, in place of `init`'s.

    Raises:
        DatasetError: If the data cannot be read.
        CheckpointError: If `out` cannot be written or another training writes there, or a file is
            unreadable or does not match.
        SettingsError: If the loss is not finite, memory is too small, there are no such starting
            weights, or the device is missing.
    """
    engine = engine or Engine()
    if engine.device == "cuda" and not torch.cuda.is_available():
        raise SettingsError("device is cuda, but there is no GPU: expected cpu")
    if not is_utf8(out):
        raise CheckpointError(
            f"{out}: its path is not UTF-8, which checkpoints and TensorBoard's log need: expected"
            " another folder"
        )
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CheckpointError(f"{out}: cannot be written ({error.strerror})") from error
    if engine.device == "cpu":
        keep_freed_memory()
    with process_group(engine.device) as processes, _alone_in(out, processes):
        source = data if isinstance(data, DataSource) else DataSource(data)
        run = _TrainingRun(spec, settings, engine, source, out, init, heads, branch, processes)
        try:
            return run.start(progress, preparing or Preparing())
        except torch.OutOfMemoryError as error:
            raise SettingsError(
                f"batch is {settings.batch}, for which the device has too little memory: expected"
                " a smaller batch, or a larger accumulate"
            ) from error


@contextmanager
def _alone_in(out: Path, processes: Processes) -> Iterator[None]:
    """Keep other trainings out of a folder; two would replace each other's state."""
    if not processes.is_lead:
        yield
        return
    with ExitStack() as stack:
        try:
            stack.enter_context(locked(out / STATE_NAME, wait_s=0.0))
        except InputFileError as error:
            if not isinstance(error.__cause__, BlockingIOError):
                raise CheckpointError(str(error)) from error
            raise CheckpointError(
                f"{out}: another training writes there: expected it to have ended, or another"
                " folder"
            ) from error
        yield


@dataclasses.dataclass
class _TrainingRun:
    spec: ModelSpec
    settings: TrainSettings
    engine: Engine
    source: DataSource
    out: Path
    init: Init | None
    heads: Path | None
    branch: Path | None
    processes: Processes

    def start(self, progress: Progress, preparing: Preparing) -> TrainReport:
        parts = self.processes.world * self.settings.accumulate
        if self.settings.batch % parts:
            raise SettingsError(
                f"batch is {self.settings.batch}: expected a multiple of {parts} (processes times"
                " accumulate)"
            )
        if (self.source.mix is None) != (self.settings.mix_share == 0):
            raise SettingsError(
                f"mix_share is {self.settings.mix_share:g} and the dataset to mix in is"
                f" {self.source.mix}: expected both or none"
            )
        model = self._model()
        data = self._open_data(preparing)
        state = self._state(data)
        precision = self._precision_of(state)
        trainer = Trainer(
            model, self.settings, self.engine, data, self.out, self.processes, precision, progress
        )
        trainer.origin = {
            "init": self._origin(),
            "data": data.name,
            "frames": len(data.frames) + len(data.mixed or ()),
            **data.origin,
            **self._credits((state or {}).get(_CREDITS)),
        }
        if state is not None:
            _restore_from(self._state_path, trainer, state, branched=not self._resumable)
            trainer.check_best(preparing.say)
        identity = self._identity(data)
        return trainer.run(lambda: write_state(trainer.state_path, _state_of(trainer), identity))

    def _open_data(self, preparing: Preparing) -> TrainingData:
        """Open the data; the process of rank 0 makes the frame cache while the others wait.

        Then it waits for them, as reading can take long, too.
        """
        if not self.processes.is_lead:
            self.processes.barrier()
        data = open_data(self.source, self.spec, self.engine, preparing)
        if self.processes.is_lead:
            self.processes.barrier()
        self.processes.barrier()
        return data

    def _model(self) -> TreeRCNN:
        torch.manual_seed(self.settings.seed)
        model = TreeRCNN(self.spec)
        fresh = not self._resumable
        if self.init is None and self.branch is None:
            for name in _NEED_START:
                if getattr(self.settings, name):
                    raise SettingsError(
                        f"{name} is set without starting weights:"
                        " expected starting weights for the backbone (--init)"
                    )
        if fresh:
            if self.init is not None:
                start_from(model, self.init)
            if self.heads is not None:
                load_heads(model, self.heads)
        return model

    def _precision_of(self, state: dict[str, Any] | None) -> str:
        """That of the state to go on from; a branch may ask for another one."""
        before = None if state is None else str(state["precision"])
        asked = self.engine.precision
        if before is None or (asked != "auto" and not self._resumable):
            return self._precision()
        if asked not in ("auto", before):
            raise SettingsError(
                f"precision is {asked} and the run to resume has {before}: expected the same, or a"
                " branch of it"
            )
        return before

    def _precision(self) -> str:
        if self.engine.precision != "auto":
            return self.engine.precision
        bf16 = fastest_precision(torch.device(self.engine.device)) == "bf16"
        return "bf16" if self.processes.broadcast_number(float(bf16)) else "fp32"

    @cached_property
    def _resumable(self) -> bool:
        """Whether the process of rank 0, which writes the run, has a state of it."""
        own = (self.out / STATE_NAME).exists()
        return self.processes.broadcast_number(float(own)) > 0

    @property
    def _state_path(self) -> Path:
        """The state to continue from: this run's, or else that of the run it branches from."""
        return (self.out if self._resumable or self.branch is None else self.branch) / STATE_NAME

    def _state(self, data: TrainingData) -> dict[str, Any] | None:
        """The state to continue: this run's, or else that of the run it branches from.

        The process of rank 0 reads it for all, as it alone writes states and other machines may
        have none.
        """
        found = self._read_state(data) if self.processes.is_lead else None
        shared: dict[str, Any] | None = self.processes.broadcast(found)
        return shared

    def _read_state(self, data: TrainingData) -> dict[str, Any] | None:
        known = {_MODEL: _spec_defaults(self.spec)}  # for states of older versions
        if self._resumable:
            identity = self._identity(data)
            defaults = {
                **known,
                "settings": _fixed_settings(TrainSettings(steps=1)),
                "data": {_VAL_HASH: identity["data"][_VAL_HASH]},
            }
            return read_state(self.out / STATE_NAME, identity, defaults)
        if self.branch is None:
            return None
        return read_state(self.branch / STATE_NAME, {_MODEL: self.spec.to_dict()}, known)

    def _origin(self) -> dict[str, Any]:
        if self.branch is not None:
            return {"name": f"branch of {self.branch.name}"}
        heads = {} if self.heads is None else {"heads": describe_init(self.heads)}
        return {**describe_init(self.init, self.spec.backbone), **heads}

    def _credits(self, before: Any) -> Credits:
        """The credits of the starting weights and data, and those of the state it goes on from."""
        files = [*files_of(self.init), *([] if self.heads is None else [self.heads])]
        sources = [self.source.directory, *([self.source.mix] if self.source.mix else [])]
        folders = [dataset_folder(each) for each in sources]
        own = training_credits(self.init, self.spec.backbone, files, folders)
        return joined_credits([own, before if isinstance(before, dict) else {}])

    def _identity(self, data: TrainingData) -> dict[str, dict[str, Any]]:
        origin = self._origin()
        return {
            _MODEL: self.spec.to_dict(),
            "settings": _fixed_settings(self.settings),
            "starting weights": {
                "weights": origin.get("sha256", origin["name"]),
                **{name: origin[name]["sha256"] for name in ("colour", "heads") if name in origin},
            },
            "data": data.describe(),
        }


def _spec_defaults(spec: ModelSpec) -> dict[str, Any]:
    """The fields of a spec that have a default, at it."""
    told = spec.to_dict().keys()
    return {
        entry.name: entry.default
        for entry in dataclasses.fields(ModelSpec)
        if entry.name in told and entry.default is not dataclasses.MISSING
    }


def _fixed_settings(settings: TrainSettings) -> dict[str, Any]:
    """The settings that may not change when a run is resumed."""
    values = settings.to_dict()
    for name in (
        ("patience", "evaluate_every_steps") if settings.depends_on_end else EXTENDABLE_SETTINGS
    ):
        del values[name]
    return values


def _state_of(trainer: Trainer) -> dict[str, Any]:
    return {
        "model": trainer.model.state_dict(),
        "average": None if trainer.average is None else trainer.average.state_dict(),
        "start": None if trainer.start is None else trainer.start.state(),
        "optimizer": trainer.optimizer.state_dict(),
        "precision": trainer.precision,
        _CREDITS: joined_credits([trainer.origin]),
        **trainer.counts.to_state(),
    }


def _restore_from(path: Path, trainer: Trainer, state: dict[str, Any], branched: bool) -> None:
    """Restore a trainer; a state whose parts do not fit it is an error that names the file."""
    try:
        _restore(trainer, state, branched)
    except (
        ArithmeticError,
        RuntimeError,
        ValueError,
        LookupError,
        TypeError,
        AttributeError,
    ) as error:
        reason = " ".join(str(error).split())[:300]
        raise CheckpointError(
            f"{path}: does not fit the training ({reason}), expected the state of the same model"
        ) from error


def _restore(trainer: Trainer, state: dict[str, Any], branched: bool) -> None:
    """Restore a trainer from a state; a branched run starts with no time and no AP."""
    trainer.model.load_state_dict(state["model"])
    if trainer.average is not None and state["average"] is not None:
        trainer.average.load_state_dict(state["average"])
    if trainer.start is not None:
        trainer.start.load_state(state.get("start") or trainer.start.own_state())
    check_optimizer_state(trainer.optimizer, state["optimizer"])
    own = [dict(group) for group in trainer.optimizer.param_groups]
    trainer.optimizer.load_state_dict(state["optimizer"])
    if branched:  # whose rates and weight decay may be others
        for group, values in zip(trainer.optimizer.param_groups, own, strict=True):
            group.update({name: value for name, value in values.items() if name != "params"})
    step = state["step"]
    trainer.counts = Counts(step, first_step=step) if branched else Counts.of_state(state)
