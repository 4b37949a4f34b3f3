"""The training loop. A resumed run gives the same weights as an uninterrupted one."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import nn

from basetree.program.interrupts import interrupt_afterwards
from perceptree.errors import CheckpointError
from perceptree.evaluation import Metrics, evaluate, predict_with
from perceptree.models import ModelSpec, TreeRCNN, load_checkpoint, save_checkpoint
from perceptree.settings.training import Engine, TrainSettings
from perceptree.training.batches import (
    Batch,
    SlotSampler,
    TrainingFrames,
    make_loader,
    prefetch_one,
)
from perceptree.training.counts import Counts, Progress, Status
from perceptree.training.gradients import Gradients
from perceptree.training.keeping import StartingBackbone
from perceptree.training.optimizer import learning_rate, make_average, make_optimizer, set_rate
from perceptree.training.processes import Processes, synchronise_norms
from perceptree.training.rounding import rounded_weights
from perceptree.training.run_log import RunLog
from perceptree.training.source import TrainingData
from perceptree.training.state import STATE_NAME

_LOG_EVERY_STEPS = 50


@dataclass(frozen=True)
class TrainReport:
    """Result of a training.

    Attributes:
        checkpoint: File of the best weights.
        metrics: Their metrics on val.
        steps: Number of steps.
        elapsed_s: Training time, s.
    """

    checkpoint: Path
    metrics: Metrics
    steps: int
    elapsed_s: float


class Trainer:
    """The training loop of one process.

    Args:
        model: Model to train.
        settings: The training.
        engine: Hardware and speed.
        data: Data to train on and to evaluate on.
        out: Folder of the run.
        processes: The processes that train together.
        precision: `fp32` or `bf16`.
        progress: Called with the status after every step.

    Attributes:
        average: Moving average of the model, if there is one.
        start: The starting backbone, if the training compares with it.
        counts: How far the training is.
        origin: Starting weights and data, for the checkpoint's training record.
    """

    def __init__(
        self,
        model: TreeRCNN,
        settings: TrainSettings,
        engine: Engine,
        data: TrainingData,
        out: Path,
        processes: Processes,
        precision: str,
        progress: Progress,
    ) -> None:
        self.settings, self.engine, self.out = settings, engine, out
        self.processes, self.precision, self._progress = processes, precision, progress
        self._data = data
        self.device = torch.device(engine.device)
        self.model = model.to(self.device)
        self.average = make_average(model, settings.ema_decay) if settings.ema_decay else None
        if engine.compile:
            for part in (*model.backbones, model.pyramid):
                part.compile()
        self.start = StartingBackbone(model, settings) if settings.keeps_start else None
        if processes.world > 1:
            synchronise_norms(model)
        model.freeze(settings.freeze_level, settings.frozen_norms)
        self.optimizer = make_optimizer(model, settings)
        self._gradients = Gradients(model, self.start, settings, processes, precision == "bf16")
        self.counts = Counts()
        self.origin: dict[str, Any] = {}
        self._log: RunLog | None = None
        self._saved_s = time.monotonic()

    @property
    def spec(self) -> ModelSpec:
        """Spec of the model."""
        return self.model.spec

    def run(self, save: Callable[[], None]) -> TrainReport:
        """Train to the end, evaluating on val at intervals.

        Args:
            save: Writes the state; also called when the training is interrupted.

        Raises:
            DatasetError: If a frame cannot be read.
            SettingsError: If the loss is not finite.
            CheckpointError: If a file cannot be written.
            KeyboardInterrupt: If interrupted, after the state is saved.
        """
        self._saved_s = time.monotonic()
        if self.processes.is_lead:
            self._log = RunLog(self.out, self.counts.step)
        try:
            self._train(save)
        except KeyboardInterrupt:
            self._save(save)
            raise
        finally:
            if self._log is not None:
                self._log.close()
        counts = self.counts
        assert counts.best is not None
        steps = counts.step - counts.first_step
        return TrainReport(self.checkpoint, counts.best, steps, counts.elapsed_s)

    def _train(self, save: Callable[[], None]) -> None:
        batches: Iterator[Batch] | None = None
        self._gradients.freeze(self.counts.step)
        if self._is_due:  # an interruption came before the evaluation
            self._evaluate()
            self._save(save)
        while (done := self.processes.broadcast_number(self.counts.done(self.settings))) < 1.0:
            if batches is None:
                batches = self._batches()
            with interrupt_afterwards():
                self._train_step(batches, done)
            self._progress(self._status())
            if self._is_due:
                self._evaluate()
                self._save(save)
            elif time.monotonic() - self._saved_s >= self.engine.save_s:
                self._save(save)
        if self.counts.evaluated_at != self.counts.step:
            self._evaluate()
            self._save(save)

    @property
    def _is_due(self) -> bool:
        """Whether the weights of this step are to be evaluated and have not been."""
        counts = self.counts
        is_due = counts.step % self.settings.evaluate_every_steps == 0
        return is_due and counts.first_step < counts.step != counts.evaluated_at

    def _save(self, save: Callable[[], None]) -> None:
        if self.processes.is_lead:
            save()
        self._saved_s = time.monotonic()

    @property
    def checkpoint(self) -> Path:
        """File of the best weights so far."""
        return self.out / "best.safetensors"

    def check_best(self, say: Callable[[str], None]) -> None:
        """Forget the best weights if their file is lost or damaged, and say so.

        The process of rank 0 looks for all, as it alone writes the file.
        """
        is_lost = False
        if self.counts.best is not None and self.processes.is_lead:
            try:
                load_checkpoint(self.checkpoint)
            except CheckpointError as error:
                say(f"{error}: the next evaluation writes it anew, from the weights it evaluates")
                is_lost = True
        if self.processes.broadcast_number(float(is_lost)):
            self.counts.forget_best()

    def _batches(self) -> Iterator[Batch]:
        data = self._data
        frames = TrainingFrames(data.frames, self.spec, self.settings, data.mixed)
        sampler = SlotSampler(
            self.settings, self.counts.step, self.processes.rank, self.processes.world
        )
        cuda = self.device.type == "cuda"
        workers = self.engine.worker_count(self.processes.world)
        batches = iter(make_loader(frames, sampler, workers, cuda))
        return batches if workers else prefetch_one(batches)

    def _train_step(self, batches: Iterator[Batch], done: float) -> None:
        started_s, settings = time.monotonic(), self.settings
        rate = learning_rate(settings, self.counts.step, done)
        set_rate(self.optimizer, rate)
        if self.counts.step == settings.frozen_steps > 0:
            self._gradients.freeze(self.counts.step)
        self.model.train()
        self.optimizer.zero_grad(set_to_none=True)
        losses, waited_s = self._gradients.compute(batches, self.counts.step)
        if settings.clip_norm is not None:
            nn.utils.clip_grad_norm_(self.model.parameters(), settings.clip_norm)
        self.optimizer.step()
        if self.start is not None:
            self.start.pull(rate * settings.backbone_rate_share)
        if self.average is not None:
            self.average.update_parameters(self.model)
        self.counts.step += 1
        self.counts.elapsed_s += time.monotonic() - started_s
        self.counts.waited_s += waited_s
        self._log_losses(losses)

    def _log_losses(self, losses: dict[str, float]) -> None:
        self.counts.add_losses(losses)
        if self.counts.step % _LOG_EVERY_STEPS == 0:
            status = self._status()
            self._write(
                {
                    "losses": status.losses,
                    "rate": status.rate,
                    "frames_per_s": round(status.frames_per_s, 3),
                    "waiting_share": round(status.waiting_share, 4),
                }
            )

    def _status(self) -> Status:
        return self.counts.status(self.settings, self.optimizer.param_groups[0]["lr"])

    def _write(self, more: dict[str, Any]) -> None:
        if self._log is not None:
            elapsed_s = round(self.counts.elapsed_s, 2)
            self._log.write({"step": self.counts.step, "elapsed_s": elapsed_s} | more)

    @property
    def evaluated_model(self) -> TreeRCNN:
        """The model to evaluate and to save: the average if there is one."""
        if self.average is None:
            return self.model
        assert isinstance(self.average.module, TreeRCNN)
        return self.average.module

    def _evaluate(self) -> None:
        """Evaluate on val, and save the best weights so far, rounded if training rounds them.

        The process of rank 0 evaluates, and shares the metrics with all processes.
        """
        model, found = self.evaluated_model, None
        with rounded_weights(model, self.settings.weight_bits):
            if self.processes.is_lead:
                found = evaluate(predict_with(model.eval()), self._data.val, batch=4)
            metrics: Metrics = self.processes.broadcast(found)
            self._write({"val": metrics.to_dict()})
            with interrupt_afterwards():  # or the state would tell of weights that are not saved
                if self.counts.add_metrics(metrics) and self.processes.is_lead:
                    self._save_best(metrics)

    def _save_best(self, metrics: Metrics) -> None:
        training = {
            "settings": self.settings.to_dict(),
            "precision": self.precision,
            "processes": self.processes.world,
            "device": self.engine.device_name,
            "steps": self.counts.step,
            "elapsed_s": round(self.counts.elapsed_s, 1),
            "val": metrics.to_dict(),
            **self.origin,
        }
        save_checkpoint(self.checkpoint, self.evaluated_model, training)

    @property
    def state_path(self) -> Path:
        """File that the training is resumed from."""
        return self.out / STATE_NAME
