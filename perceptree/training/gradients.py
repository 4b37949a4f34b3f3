"""The losses of a training step and their gradients, over its parts and all processes."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.parallel import DistributedDataParallel

from basetree.errors import SettingsError
from perceptree.errors import DatasetError
from perceptree.models import TreeRCNN
from perceptree.models.losses import CountReducer
from perceptree.settings.training import LAST_LEVEL, TrainSettings
from perceptree.training.batches import Batch, SeededDraws
from perceptree.training.keeping import StartingBackbone
from perceptree.training.processes import Processes
from perceptree.training.rounding import rounded_weights

_NAMES_SHOWN = 8


class _Losses(nn.Module):
    """All losses as a forward pass, which DistributedDataParallel requires."""

    def __init__(self, model: TreeRCNN, start: StartingBackbone | None) -> None:
        super().__init__()
        self.model, self._start = model, start

    def forward(self, *arguments: Any) -> dict[str, Tensor]:
        """Return the losses of TreeRCNN.losses, and that of the starting backbone."""
        losses = self.model.losses(*arguments)
        mean_count: CountReducer = arguments[-1]
        return losses if self._start is None else losses | self._start.loss(mean_count)


class Gradients:
    """Computes the gradients of steps.

    Args:
        model: The model, on the device of the training.
        start: The starting backbone, if the training compares with it.
        settings: The training.
        processes: The processes that train together.
        bf16: Whether to compute in bfloat16 where that is safe.
    """

    def __init__(
        self,
        model: TreeRCNN,
        start: StartingBackbone | None,
        settings: TrainSettings,
        processes: Processes,
        bf16: bool,
    ) -> None:
        self._model, self._start, self._settings = model, start, settings
        self._processes, self._bf16 = processes, bf16
        self._device = next(model.parameters()).device
        self._losses: nn.Module = _Losses(model, start)

    def freeze(self, step: int) -> None:
        """Freeze what the part of the training that begins with a step leaves as it is."""
        settings = self._settings
        whole = step < settings.frozen_steps
        level = LAST_LEVEL if whole else settings.freeze_level
        self._model.freeze(level, whole or settings.frozen_norms)
        self._losses = _Losses(self._model, self._start)
        if self._processes.world > 1:
            self._losses = DistributedDataParallel(self._losses, broadcast_buffers=False)

    def compute(self, batches: Iterator[Batch], step: int) -> tuple[dict[str, float], float]:
        """Compute the gradients of a step.

        Args:
            batches: Where the step's parts are taken from.
            step: Number of the step, for messages.

        Returns:
            Mean of each loss over the parts and all processes, and the time spent waiting for
            data, s.

        Raises:
            DatasetError: If a frame cannot be read.
            SettingsError: If the loss is not finite.
        """
        parts: list[dict[str, Tensor]] = []
        names: list[str] = []
        waited_s = 0.0
        for part in range(self._settings.accumulate):
            asked_s = time.monotonic()
            batch = next(batches)
            waited_s += time.monotonic() - asked_s
            if batch.fault is not None:
                raise DatasetError(batch.fault)
            names += batch.names
            parts.append(self._backward(batch, part == self._settings.accumulate - 1))
        table = torch.stack([torch.stack(list(part.values())) for part in parts]).mean(0)
        losses = dict(zip(parts[0], self._processes.mean(table).tolist(), strict=True))
        self._check_finite(losses, step, names)
        return losses, waited_s

    def _backward(self, batch: Batch, last: bool) -> dict[str, Tensor]:
        """Losses and gradients of a part; the processes exchange them with the last part."""
        images = batch.images.to(self._device, non_blocking=True)
        assert batch.targets is not None
        targets, draw = batch.targets.unpack(self._device), SeededDraws(batch.seeds)
        exchange: AbstractContextManager[None] = nullcontext()
        if not last and isinstance(self._losses, DistributedDataParallel):
            exchange = self._losses.no_sync()
        with rounded_weights(self._model, self._settings.weight_bits):
            with exchange, torch.autocast(self._device.type, torch.bfloat16, self._bf16):
                losses: dict[str, Tensor] = self._losses(
                    images, targets, self._settings.sampling, draw, self._processes.mean
                )
            total = torch.stack(list(losses.values())).sum() / self._settings.accumulate
            total.backward()  # type: ignore[no-untyped-call]
        return {name: loss.detach() for name, loss in losses.items()}

    def _check_finite(self, losses: dict[str, float], step: int, names: list[str]) -> None:
        total = sum(losses.values())
        if not math.isfinite(total):
            more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
            raise SettingsError(
                f"the loss is {total} at step {step}, on the frames"
                f" {', '.join(names[:_NAMES_SHOWN])}{more}: expected a finite number; try a"
                f" learning rate below {self._settings.learning_rate:g}"
            )
