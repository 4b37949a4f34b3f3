"""The training loop. A resumed run gives the same weights as an uninterrupted one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from basetree.errors import SettingsError
from basetree.program.interrupts import interrupt_afterwards
from perceptree.errors import DatasetError
from perceptree.evaluation import Metrics, evaluate, predict_with
from perceptree.models import ModelSpec, TreeRCNN, save_checkpoint
from perceptree.settings.training import LAST_LEVEL, Engine, TrainSettings
from perceptree.training.average import make_average
from perceptree.training.batches import (
    Batch,
    SeededDraws,
    SlotSampler,
    TrainingFrames,
    make_loader,
    prefetch_one,
)
from perceptree.training.keeping import StartingBackbone
from perceptree.training.optimizer import make_optimizer, set_rate
from perceptree.training.processes import Processes, synchronise_norms
from perceptree.training.rounding import rounded_weights
from perceptree.training.run_log import RunLog
from perceptree.training.schedule import learning_rate
from perceptree.training.source import TrainingData
from perceptree.training.state import STATE_NAME

_SECONDS_PER_MINUTE = 60.0
_LOG_EVERY_STEPS = 50
# Weight of the newest loss in the running means.
_LOSS_MEAN_RATE = 0.02
_NAMES_SHOWN = 8


@dataclass(frozen=True)
class Status:
    """Progress of a training.

    Attributes:
        done: Completed fraction, 0 to 1.
        step: Number of completed steps.
        losses: Running mean of each loss.
        elapsed_s: Training time, s.
        waiting_share: Fraction of the training time spent waiting for data.
        frames_per_s: Frames per second.
        rate: Learning rate.
        box_ap: Latest box AP on val; None before the first evaluation.
    """

    done: float
    step: int
    losses: dict[str, float]
    elapsed_s: float
    waiting_share: float
    frames_per_s: float
    rate: float
    box_ap: float | None


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


Progress = Callable[[Status], None]


class _Losses(nn.Module):
    """All losses as a forward pass, which DistributedDataParallel requires."""

    def __init__(self, model: TreeRCNN, start: StartingBackbone | None) -> None:
        super().__init__()
        self.model, self._start = model, start

    def forward(self, *arguments: Any) -> dict[str, Tensor]:
        """Return the losses of TreeRCNN.losses, and that of the starting backbone."""
        losses = self.model.losses(*arguments)
        return losses if self._start is None else losses | self._start.loss()


class Trainer:
    """The training loop of one process.

    Args:
        model: Model to train.
        settings: The training.
        engine: Hardware and speed.
        data: Data to train on and to evaluate on.
        out: Folder of the run.
        processes: The processes that train together.
        precision: ``fp32`` or ``bf16``.
        progress: Called with the status after every step.

    Attributes:
        average: Moving average of the model, if there is one.
        start: The starting backbone, if the training compares with it.
        step: Number of completed steps, those of the run it branched from included.
        first_step: The step that this run started at.
        elapsed_s: Training time, s.
        waited_s: Time spent waiting for data, s.
        means: Running mean of each loss.
        best: Metrics of the best weights so far.
        stale: Number of evaluations since the best one.
        evaluated_at: Step of the last evaluation, -1 before the first.
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
            model.backbone.compile()
            model.pyramid.compile()
        self.start = StartingBackbone(model, settings) if settings.keeps_start else None
        if processes.world > 1:
            synchronise_norms(model)
        model.freeze(settings.freeze_level, settings.frozen_norms)
        self.optimizer = make_optimizer(model, settings)
        self._losses: nn.Module = _Losses(model, self.start)
        self.step, self.first_step, self.elapsed_s, self.waited_s = 0, 0, 0.0, 0.0
        self.best: Metrics | None = None
        self.stale, self.evaluated_at = 0, -1
        self._latest_ap: float | None = None
        self.means: dict[str, float] = {}
        self.origin: dict[str, Any] = {}
        self._log: RunLog | None = None
        self._saved_s = time.monotonic()

    def _freeze(self) -> None:
        """Freeze what this part of the training leaves as it is."""
        settings = self.settings
        whole = self.step < settings.frozen_steps
        level = LAST_LEVEL if whole else settings.freeze_level
        self.model.freeze(level, whole or settings.frozen_norms)
        self._losses = _Losses(self.model, self.start)
        if self.processes.world > 1:
            self._losses = DistributedDataParallel(self._losses, broadcast_buffers=False)

    @property
    def spec(self) -> ModelSpec:
        """Spec of the model."""
        return self.model.spec

    @property
    def done(self) -> float:
        """Completed fraction of the training, 0 to 1."""
        settings = self.settings
        if settings.patience is not None and self.stale >= settings.patience:
            return 1.0
        if settings.minutes is not None:
            return min(1.0, self.elapsed_s / (settings.minutes * _SECONDS_PER_MINUTE))
        return min(1.0, (self.step - self.first_step) / (settings.steps or 1))

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
            self._log = RunLog(self.out, self.step)
        try:
            self._train(save)
        except KeyboardInterrupt:
            self._save(save)
            raise
        finally:
            if self._log is not None:
                self._log.close()
        assert self.best is not None
        return TrainReport(self.checkpoint, self.best, self.step - self.first_step, self.elapsed_s)

    def _train(self, save: Callable[[], None]) -> None:
        batches: Iterator[Batch] | None = None
        self._freeze()
        while (done := self.processes.broadcast_number(self.done)) < 1.0:
            if batches is None:
                batches = self._batches()
            with interrupt_afterwards():
                self._train_step(batches, done)
            self._progress(self._status())
            if self.step % self.settings.evaluate_every_steps == 0:
                self._evaluate()
                self._save(save)
            elif time.monotonic() - self._saved_s >= self.engine.save_s:
                self._save(save)
        if self.evaluated_at != self.step:
            self._evaluate()
            self._save(save)

    def _save(self, save: Callable[[], None]) -> None:
        if self.processes.is_lead:
            save()
        self._saved_s = time.monotonic()

    @property
    def checkpoint(self) -> Path:
        """File of the best weights so far."""
        return self.out / "best.safetensors"

    def _batches(self) -> Iterator[Batch]:
        data = self._data
        frames = TrainingFrames(data.frames, self.spec, self.settings, data.mixed)
        sampler = SlotSampler(self.settings, self.step, self.processes.rank, self.processes.world)
        cuda = self.device.type == "cuda"
        workers = self.engine.worker_count(self.processes.world)
        batches = iter(make_loader(frames, sampler, workers, cuda))
        return batches if workers else prefetch_one(batches)

    def _train_step(self, batches: Iterator[Batch], done: float) -> None:
        started_s = time.monotonic()
        settings, waited_s = self.settings, 0.0
        rate = learning_rate(settings, self.step, done)
        set_rate(self.optimizer, rate)
        if self.step == settings.frozen_steps > 0:
            self._freeze()
        self.model.train()
        self.optimizer.zero_grad(set_to_none=True)
        parts: list[dict[str, Tensor]] = []
        names: list[str] = []
        for part in range(settings.accumulate):
            asked_s = time.monotonic()
            batch = next(batches)
            waited_s += time.monotonic() - asked_s
            if batch.fault is not None:
                raise DatasetError(batch.fault)
            names += batch.names
            last = part == settings.accumulate - 1
            parts.append(self._backward(batch, last))
        losses = self._mean_losses(parts)
        self._check_finite(losses, names)
        if settings.clip_norm is not None:
            nn.utils.clip_grad_norm_(self.model.parameters(), settings.clip_norm)
        self.optimizer.step()
        if self.start is not None:
            self.start.pull(rate * settings.backbone_rate_share)
        if self.average is not None:
            self.average.update_parameters(self.model)
        self.step += 1
        self.elapsed_s += time.monotonic() - started_s
        self.waited_s += waited_s
        self._log_losses(losses)

    def _backward(self, batch: Batch, last: bool) -> dict[str, Tensor]:
        with rounded_weights(self.model, self.settings.weight_bits):
            return self._exact_backward(batch, last)

    def _exact_backward(self, batch: Batch, last: bool) -> dict[str, Tensor]:
        """Losses and gradients with the weights as they are."""
        images = batch.images.to(self.device, non_blocking=True)
        draw = SeededDraws(batch.seeds)
        assert batch.targets is not None
        targets = batch.targets.unpack(self.device)
        with torch.autocast(self.device.type, torch.bfloat16, self.precision == "bf16"):
            arguments = (
                images,
                targets,
                self.settings.sampling,
                draw,
                self.processes.mean_count,
            )
            if last or not isinstance(self._losses, DistributedDataParallel):
                losses: dict[str, Tensor] = self._losses(*arguments)
            else:
                with self._losses.no_sync():
                    losses = self._losses(*arguments)
        total = torch.stack(list(losses.values())).sum() / self.settings.accumulate
        total.backward()  # type: ignore[no-untyped-call]
        return {name: loss.detach() for name, loss in losses.items()}

    def _mean_losses(self, parts: list[dict[str, Tensor]]) -> dict[str, float]:
        """Mean of each loss over the parts of a step and all processes."""
        table = torch.stack([torch.stack(list(part.values())) for part in parts]).mean(0)
        return dict(zip(parts[0], self.processes.mean(table).tolist(), strict=True))

    def _check_finite(self, losses: dict[str, float], names: list[str]) -> None:
        total = sum(losses.values())
        if not math.isfinite(total):
            more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
            raise SettingsError(
                f"the loss is {total} at step {self.step}, on the frames"
                f" {', '.join(names[:_NAMES_SHOWN])}{more}: expected a finite number; try a"
                f" learning rate below {self.settings.learning_rate:g}"
            )

    def _log_losses(self, losses: dict[str, float]) -> None:
        for name, value in losses.items():
            known = self.means.get(name, value)
            taken = self.step - self.first_step
            self.means[name] = known + (value - known) * max(_LOSS_MEAN_RATE, 1 / taken)
        if self.step % _LOG_EVERY_STEPS == 0:
            status = self._status()
            self._write(
                {
                    "losses": self.means,
                    "rate": status.rate,
                    "frames_per_s": round(status.frames_per_s, 3),
                    "waiting_share": round(status.waiting_share, 4),
                }
            )

    def _status(self) -> Status:
        steps, elapsed_s = self.step - self.first_step, max(self.elapsed_s, 1e-9)
        return Status(
            self.done,
            self.step,
            dict(self.means),
            self.elapsed_s,
            self.waited_s / elapsed_s,
            steps * self.settings.batch / elapsed_s,
            self.optimizer.param_groups[0]["lr"],
            self._latest_ap,
        )

    def _write(self, more: dict[str, Any]) -> None:
        if self._log is not None:
            self._log.write({"step": self.step, "elapsed_s": round(self.elapsed_s, 2)} | more)

    @property
    def evaluated_model(self) -> TreeRCNN:
        """The model to evaluate and to save: the average if there is one."""
        if self.average is None:
            return self.model
        assert isinstance(self.average.module, TreeRCNN)
        return self.average.module

    def _evaluate(self) -> None:
        """Evaluate on val, and save the best weights so far, rounded if training rounds them."""
        with rounded_weights(self.evaluated_model, self.settings.weight_bits):
            self._evaluate_and_save()

    def _evaluate_and_save(self) -> None:
        """Evaluate in the process of rank 0, and share the metrics with all processes."""
        found = None
        if self.processes.is_lead:
            found = evaluate(predict_with(self.evaluated_model.eval()), self._data.val, batch=4)
        metrics: Metrics = self.processes.broadcast(found)
        self._write({"val": metrics.to_dict()})
        self._latest_ap, self.evaluated_at = metrics.box_ap, self.step
        risen = self.best is None or metrics.box_ap > self.best.box_ap
        self.stale = 0 if risen else self.stale + 1
        if self.best is None or metrics.box_ap >= self.best.box_ap:
            self.best = metrics
            if self.processes.is_lead:
                self._save_best(metrics)

    def _save_best(self, metrics: Metrics) -> None:
        training = {
            "settings": self.settings.to_dict(),
            "precision": self.precision,
            "processes": self.processes.world,
            "device": self.engine.device_name,
            "steps": self.step,
            "elapsed_s": round(self.elapsed_s, 1),
            "val": metrics.to_dict(),
            **self.origin,
        }
        save_checkpoint(self.checkpoint, self.evaluated_model, training)

    @property
    def state_path(self) -> Path:
        """File that the training is resumed from."""
        return self.out / STATE_NAME
