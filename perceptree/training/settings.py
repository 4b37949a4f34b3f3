"""Settings of a training: validated dataclasses.

:class:`TrainSettings` determine the result and are stored in the checkpoint. :class:`Engine`
determines hardware and speed.
"""

from __future__ import annotations

import dataclasses
import math
import os
from dataclasses import dataclass, field
from typing import Any, Literal

import torch

from basetree.errors import SettingsError
from perceptree.data import AugmentSettings
from perceptree.models import SampleSettings

Schedule = Literal["constant", "steps", "cosine", "decay"]

_POSITIVE = (
    "steps",
    "minutes",
    "patience",
    "batch",
    "accumulate",
    "learning_rate",
    "warmup_steps",
    "clip_norm",
    "evaluate_every_steps",
)
_SHARES = ("final_rate_share", "rate_drop", "backbone_rate_share")
_AT_LEAST_0 = ("weight_decay", "frozen_steps", "keep_weights", "keep_features", "seed")
_CHOICES = {"optimizer": ("adamw", "sgd"), "schedule": ("constant", "steps", "cosine", "decay")}
LAST_LEVEL = 5  # of a backbone
_FEW_CORES = 2
_MOST_BITS = 8

EXTENDABLE_SETTINGS = ("steps", "minutes", "patience", "evaluate_every_steps")
"""Settings that may change when a run is resumed, unless its schedule depends on the end."""


@dataclass(frozen=True)
class TrainSettings:
    """How a detector is trained.

    Attributes:
        steps: Number of steps; either this or ``minutes`` is given.
        minutes: Training time, min.
        patience: Evaluations without a higher box AP on val after which training ends early; None
            for no early end.
        batch: Frames per step, over all processes.
        mix_share: Share of each batch that comes from the dataset that is mixed in; 0 without one.
        accumulate: Parts per step whose gradients are summed, to save memory.
        optimizer: ``adamw`` or ``sgd``.
        momentum: Momentum of SGD.
        learning_rate: Learning rate after the warm-up.
        schedule: Learning rate after the warm-up: ``constant``; ``steps`` multiplies it by
            ``rate_drop`` at each of ``rate_steps``; ``cosine`` and ``decay`` lower it to
            ``final_rate_share`` of its value, along a cosine and a line.
        rate_steps: Steps at which ``steps`` lowers the rate, ascending.
        rate_drop: Factor of the rate at these steps.
        final_rate_share: Fraction of the rate at the end of ``cosine`` and ``decay``.
        weight_decay: Weight decay of all parameters but norms and biases.
        warmup_steps: Steps over which the rate rises linearly from 0.
        clip_norm: Maximum norm of the gradient; None for no limit.
        ema_decay: Decay per step of the moving average of the weights; 0 for no average.
        evaluate_every_steps: Steps between evaluations on val.
        seed: Seed of all random numbers.
        freeze_level: Freeze the backbone up to the maps of stride ``2**freeze_level``; 0 freezes
            nothing, 2 is Detectron2's FREEZE_AT 2.
        frozen_norms: Freeze all batch norms of the backbone.
        frozen_steps: Steps at the start in which all of the backbone is frozen.
        backbone_rate_share: Learning rate of the backbone, as a share of that of the other parts.
        keep_weights: Pull of the backbone's weights towards their starting values (L2-SP, Li et
            al. 2018): each step takes away its product with the learning rate from the distance.
        keep_features: Weight of the loss that holds the backbone's maps near those of its starting
            weights on the same pictures (Li et al. 2019, feature distillation).
        weight_bits: Bits that weights are rounded to while training, for an INT8 file; None for
            exact weights.
        augment: Augmentation of the frames.
        sampling: Sampling of anchors and regions.

    Raises:
        SettingsError: If a value is out of range.
    """

    steps: int | None = None
    minutes: float | None = None
    patience: int | None = None
    batch: int = 8
    mix_share: float = 0.0
    accumulate: int = 1
    optimizer: Literal["adamw", "sgd"] = "adamw"
    momentum: float = 0.9
    learning_rate: float = 1.5e-3
    schedule: Schedule = "constant"
    rate_steps: tuple[int, ...] = ()
    rate_drop: float = 0.1
    final_rate_share: float = 0.01
    weight_decay: float = 0.05
    warmup_steps: int = 150
    clip_norm: float | None = 10.0
    ema_decay: float = 0.998
    evaluate_every_steps: int = 1000
    seed: int = 0
    freeze_level: int = 0
    frozen_norms: bool = False
    frozen_steps: int = 0
    backbone_rate_share: float = 1.0
    keep_weights: float = 0.0
    keep_features: float = 0.0
    weight_bits: int | None = None
    augment: AugmentSettings = field(default_factory=AugmentSettings)
    sampling: SampleSettings = field(default_factory=SampleSettings)

    def __post_init__(self) -> None:
        if (self.steps is None) == (self.minutes is None):
            raise SettingsError(
                f"steps is {self.steps} and minutes {self.minutes}: expected exactly one of them"
            )
        for name in _POSITIVE:
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingsError(f"{name} is {value}: expected more than 0")
        for name in _SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise SettingsError(f"{name} is {getattr(self, name)}: expected 0 to 1")
        for name, choices in _CHOICES.items():
            if getattr(self, name) not in choices:
                raise SettingsError(
                    f"{name} is {getattr(self, name)!r}: expected one of {', '.join(choices)}"
                )
        self._check_bounds()

    def _check_bounds(self) -> None:
        for name in _AT_LEAST_0:
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise SettingsError(f"{name} is {value}: expected at least 0")
        for name in ("ema_decay", "momentum"):
            if not 0 <= getattr(self, name) < 1:
                raise SettingsError(
                    f"{name} is {getattr(self, name)}: expected at least 0, under 1"
                )
        share = self.mix_share
        if share and not (0 < share < 1 and 0 < self.mixed_rows < self.batch):
            raise SettingsError(
                f"mix_share is {share:g} of a batch of {self.batch}: expected at least one"
                " frame of each dataset in a batch"
            )
        if self.batch % self.accumulate:
            raise SettingsError(
                f"accumulate is {self.accumulate}: expected a divisor of the batch, {self.batch}"
            )
        if list(self.rate_steps) != sorted(set(self.rate_steps)):
            raise SettingsError(f"rate_steps is {self.rate_steps}: expected ascending step numbers")
        if not 0 <= self.freeze_level <= LAST_LEVEL:
            raise SettingsError(f"freeze_level is {self.freeze_level}: expected 0 to {LAST_LEVEL}")
        if self.weight_bits is not None and not 2 <= self.weight_bits <= _MOST_BITS:
            raise SettingsError(
                f"weight_bits is {self.weight_bits}: expected 2 to {_MOST_BITS}, or none"
            )

    @property
    def mixed_rows(self) -> int:
        """Frames of each batch that come from the dataset that is mixed in."""
        return round(self.mix_share * self.batch)

    @property
    def keeps_start(self) -> bool:
        """Whether the training compares the backbone with its starting weights."""
        return self.keep_weights > 0 or self.keep_features > 0

    @property
    def depends_on_end(self) -> bool:
        """Whether the learning rate depends on when the training ends."""
        return self.schedule in ("cosine", "decay")

    def to_dict(self) -> dict[str, Any]:
        """Convert to values that JSON can hold."""
        return dataclasses.asdict(self)


@dataclass(frozen=True)
class Engine:
    """Hardware and speed of a training.

    Attributes:
        device: ``cpu`` or ``cuda``.
        precision: ``fp32``, ``bf16``, or ``auto`` for the faster one on this machine.
        workers: Processes that prepare batches, 0 for none; None chooses by the number of cores.
        compile: Compile backbone and pyramid by torch, which takes minutes and pays off on GPUs.
        cache: Folder of the decoded frames; by default inside the dataset.
        save_s: Time between saved states, s.
        skip_broken: Leave out frames whose files are missing or broken.

    Raises:
        SettingsError: If a value is out of range.
    """

    device: Literal["cpu", "cuda"] = "cpu"
    precision: Literal["auto", "fp32", "bf16"] = "auto"
    workers: int | None = None
    compile: bool = False
    cache: str | None = None
    save_s: float = 60.0
    skip_broken: bool = False

    def __post_init__(self) -> None:
        if self.device not in ("cpu", "cuda"):
            raise SettingsError(f"device is {self.device!r}: expected cpu or cuda")
        if self.precision not in ("auto", "fp32", "bf16"):
            raise SettingsError(f"precision is {self.precision!r}: expected auto, fp32 or bf16")
        if self.workers is not None and self.workers < 0:
            raise SettingsError(f"workers is {self.workers}: expected at least 0")
        if not self.save_s > 0:
            raise SettingsError(f"save_s is {self.save_s}: expected more than 0")

    @property
    def device_name(self) -> str:
        """Name of the GPU, or the number of CPU cores."""
        if self.device == "cuda":
            return str(torch.cuda.get_device_name())
        return f"{os.cpu_count()} CPU cores"

    def worker_count(self, processes: int) -> int:
        """Number of processes that prepare batches for each of ``processes`` training ones."""
        if self.workers is not None:
            return self.workers
        cores = os.cpu_count() or 1
        if self.device == "cuda":
            return max(1, (cores - 1) // processes)
        # On two cores a worker brings no gain, as it competes with the network
        # (benchmarks/training.py).
        return 1 if cores // processes > _FEW_CORES else 0
