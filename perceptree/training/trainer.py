"""The training loop: resumable to the same weights, ended by steps or by the clock."""

from __future__ import annotations

import copy
import json
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from perceptree.data import FrameStore, Sample, augment, read_split
from perceptree.errors import CheckpointError, DatasetError, SettingsError
from perceptree.evaluation import Metrics, evaluate, predict_with
from perceptree.models import ModelSpec, TreeRCNN, save_checkpoint
from perceptree.training.settings import TrainSettings
from perceptree.training.starting import Init, describe_init, start_from
from perceptree.training.state import interrupt_afterwards, read_state, write_state

_SECONDS = 60.0
_LOG_EVERY_STEPS = 50
# Of the running means of the losses that are told.
_NEWEST_SHARE = 0.02
STATE_NAME = "state.pt"


@dataclass(frozen=True)
class Status:
    """Where a training stands: share done (0 to 1), steps, mean losses, seconds so far."""

    done: float
    step: int
    losses: dict[str, float]
    elapsed_s: float


@dataclass(frozen=True)
class TrainReport:
    """What a training made: the best checkpoint, its metrics on val, steps and seconds."""

    checkpoint: Path
    metrics: Metrics
    steps: int
    elapsed_s: float


Progress = Callable[[Status], None]


class Trainer:
    """One training run in a folder: ``state.pt`` to resume, ``best.safetensors``, ``log.jsonl``.

    Starting weights are fetched only where there is no state to resume.
    """

    def __init__(
        self,
        spec: ModelSpec,
        settings: TrainSettings,
        data: Path,
        out: Path,
        progress: Progress,
        init: Init | None = None,
    ) -> None:
        self.spec, self.settings, self.out, self._progress = spec, settings, out, progress
        records = [read_split(data, split) for split in ("train", "val")]
        self._init = describe_init(init)
        torch.manual_seed(settings.seed)
        self.model = TreeRCNN(spec).to(memory_format=torch.channels_last)
        if init is None and settings.frozen_norms:
            raise SettingsError(
                "frozen_norms is true without starting weights: expected weights whose norms "
                "were trained (--init)"
            )
        if init is not None and not self.resumable:
            start_from(self.model, init)
        self.model.freeze(settings.freeze_level, settings.frozen_norms)
        self._train, self._val = (FrameStore(frames, spec) for frames in records)
        for split, store in (("train", self._train), ("val", self._val)):
            if store.trees == 0:
                raise DatasetError(f"{data}: the split {split} has no labelled tree, expected some")
        self._data = {"name": data.name, "train": len(self._train), "val": len(self._val)}
        self.average = copy.deepcopy(self.model).eval().requires_grad_(False)
        self._optimizer = torch.optim.AdamW(self._parameter_groups(), lr=settings.learning_rate)
        self.step, self._elapsed_s, self._evaluated = 0, 0.0, 0
        self._best: Metrics | None = None
        self._means: dict[str, float] = {}

    def _parameter_groups(self) -> list[dict[str, Any]]:
        trained = [p for p in self.model.parameters() if p.requires_grad]
        decayed = [p for p in trained if p.ndim > 1]
        plain = [p for p in trained if p.ndim <= 1]
        return [
            {"params": decayed, "weight_decay": self.settings.weight_decay},
            {"params": plain, "weight_decay": 0.0},
        ]

    @property
    def done(self) -> float:
        """Share of the training that is over, 0 to 1."""
        if self.settings.minutes is not None:
            return min(1.0, self._elapsed_s / (self.settings.minutes * _SECONDS))
        return min(1.0, self.step / (self.settings.steps or 1))

    def run(self) -> TrainReport:
        """Train to the end, evaluating on val on the way; interrupted, the state is saved."""
        try:
            while self.done < 1.0:
                with interrupt_afterwards():
                    self._train_step()
                self._progress(Status(self.done, self.step, dict(self._means), self._elapsed_s))
                if self.step % self.settings.save_every_steps == 0:
                    self.save_state()
                if int(self.done * self.settings.evaluations) > self._evaluated:
                    self._evaluate()
        except KeyboardInterrupt:
            self.save_state()
            raise
        if self._best is None or self._evaluated < self.settings.evaluations:
            self._evaluate()
        assert self._best is not None
        return TrainReport(self.checkpoint, self._best, self.step, self._elapsed_s)

    @property
    def checkpoint(self) -> Path:
        """The best weights so far."""
        return self.out / "best.safetensors"

    def _train_step(self) -> None:
        started = time.monotonic()
        settings = self.settings
        # Randomness follows from seed and step alone, so that a resumed run repeats it.
        rng = np.random.default_rng([settings.seed, self.step])
        torch.manual_seed(int(rng.integers(2**62)))
        samples = [
            augment(rng, self._train[index], self.spec, settings.augment)
            for index in self._batch_indices()
        ]
        for group in self._optimizer.param_groups:
            group["lr"] = self._learning_rate()
        self.model.train()
        losses = self._losses(samples)
        total = sum(losses.values(), torch.zeros(()))
        if not math.isfinite(total.item()):
            raise SettingsError(
                f"the loss is {total.item()} at step {self.step}: expected a finite one; "
                f"try a learning rate under {settings.learning_rate:g}"
            )
        self._optimizer.zero_grad(set_to_none=True)
        total.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), settings.clip_norm)
        self._optimizer.step()
        self._update_average()
        self.step += 1
        self._elapsed_s += time.monotonic() - started
        self._report(losses)

    def _losses(self, samples: list[Sample]) -> dict[str, Tensor]:
        images = torch.from_numpy(np.stack([sample.image for sample in samples]))
        with torch.autocast("cpu", torch.bfloat16):
            targets = [sample.targets() for sample in samples]
            return self.model.losses(images, targets, self.settings.sampling)

    def _batch_indices(self) -> list[int]:
        """The next frames: every epoch is a permutation of its own."""
        size, batch = len(self._train), self.settings.batch
        numbers = range(self.step * batch, (self.step + 1) * batch)
        orders = {
            epoch: np.random.default_rng([self.settings.seed, 1, epoch]).permutation(size)
            for epoch in {number // size for number in numbers}
        }
        return [int(orders[number // size][number % size]) for number in numbers]

    def _learning_rate(self) -> float:
        settings = self.settings
        warm = min(1.0, (self.step + 1) / settings.warmup_steps)
        cosine = 0.5 * (1 + math.cos(math.pi * self.done))
        share = settings.final_rate_share + (1 - settings.final_rate_share) * cosine
        return settings.learning_rate * warm * share

    @torch.no_grad()
    def _update_average(self) -> None:
        decay = min(self.settings.ema_decay, (1 + self.step) / (10 + self.step))
        current = self.model.state_dict()
        for name, value in self.average.state_dict().items():
            if value.dtype.is_floating_point:
                value.lerp_(current[name], 1 - decay)
            else:
                value.copy_(current[name])

    def _report(self, losses: dict[str, Tensor]) -> None:
        for name, tensor in losses.items():
            value = float(tensor.detach())
            known = self._means.get(name, value)
            self._means[name] = known + (value - known) * max(_NEWEST_SHARE, 1 / self.step)
        if self.step % _LOG_EVERY_STEPS == 0:
            self._log({})

    def _log(self, more: dict[str, Any]) -> None:
        entry = {"step": self.step, "elapsed_s": round(self._elapsed_s, 2), "losses": self._means}
        path = self.out / "log.jsonl"
        try:
            with path.open("a", encoding="utf-8") as log:
                log.write(json.dumps(entry | more) + "\n")
        except OSError as error:
            raise CheckpointError(f"{path}: cannot be written ({error.strerror})") from error

    def _evaluate(self) -> None:
        metrics = evaluate(predict_with(self.average), self._val, batch=4)
        self._log({"val": metrics.to_dict()})
        if self._best is None or metrics.box_ap >= self._best.box_ap:
            self._best = metrics
            training = {
                "settings": self.settings.to_dict(),
                "init": self._init,
                "data": self._data["name"],
                "frames": len(self._train),
                "steps": self.step,
                "val": metrics.to_dict(),
            }
            save_checkpoint(self.checkpoint, self.average, training)
        self._evaluated = max(self._evaluated + 1, int(self.done * self.settings.evaluations))
        self.save_state()

    @property
    def _identity(self) -> dict[str, Any]:
        return {
            "model settings": self.spec.to_dict(),
            "settings": self.settings.to_dict(),
            "starting weights": self._init.get("sha256", self._init["name"]),
            "data": self._data,
        }

    def save_state(self) -> None:
        """Write everything that :meth:`resume` needs, all or nothing."""
        state = {
            "model": self.model.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "step": self.step,
            "elapsed_s": self._elapsed_s,
            "evaluated": self._evaluated,
            "means": self._means,
            "best": None if self._best is None else self._best.to_dict(),
        }
        write_state(self._state_path, state, self._identity)

    def resume(self) -> None:
        """Go on where the state left off; raises CheckpointError where it does not fit."""
        state = read_state(self._state_path, self._identity)
        self.model.load_state_dict(state["model"])
        self.average.load_state_dict(state["average"])
        self._optimizer.load_state_dict(state["optimizer"])
        self.step, self._elapsed_s = state["step"], state["elapsed_s"]
        self._evaluated, self._means = state["evaluated"], state["means"]
        self._best = None if state["best"] is None else Metrics(**state["best"])

    @property
    def resumable(self) -> bool:
        """Whether the folder has a state to go on from."""
        return self._state_path.exists()

    @property
    def _state_path(self) -> Path:
        return self.out / STATE_NAME


def train(
    spec: ModelSpec,
    settings: TrainSettings,
    data: Path,
    out: Path,
    progress: Progress = lambda status: None,
    init: Init | None = None,
) -> TrainReport:
    """Train ``spec`` on a dataset's train split into the folder ``out``.

    It starts from random weights, or from those that ``init`` names. A folder with ``state.pt``
    of the same spec, settings, starting weights and data is resumed: an ``init`` file must still
    be there and the same, published weights are not fetched again. Raises DatasetError for data
    that cannot be read, CheckpointError where ``out`` cannot be written or a file does not fit,
    SettingsError where the loss stops being finite or no such weights exist.
    """
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise CheckpointError(f"{out}: cannot be written ({error.strerror})") from error
    trainer = Trainer(spec, settings, data, out, progress, init)
    if trainer.resumable:
        trainer.resume()
    return trainer.run()
