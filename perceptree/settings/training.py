"""Settings of a training.

`TrainSettings` determine the result and are stored in the checkpoint. `DataSource`
names the data, `Engine` determines hardware and speed.
"""

from __future__ import annotations

import dataclasses
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Literal

from basetree.settings import (
    NOT_AN_OPTION,
    Settings,
    label,
    limits,
    names,
    option,
    shown_default,
)
from basetree.settings.metadata import Metadata
from perceptree.settings.augmentation import AugmentSettings
from perceptree.settings.sampling import SampleSettings

Schedule = Literal["constant", "steps", "cosine", "decay"]

LAST_LEVEL = 5  # of a backbone
CERTAIN = limits(over=0, expected="more than 0, or none", unit="m") | label("certain distance")

_FEW_CORES = 2
_POSITIVE, _AT_LEAST_0, _SHARE = limits(over=0), limits(0), limits(0, 1)
_UNDER_1 = limits(0, under=1)
_SCHEDULES = names(("constant", "steps", "cosine", "decay"))
_EVALUATE_EVERY: Metadata = _POSITIVE | option("--evaluate-every")
_FROZEN_NORMS = option("--frozen-norms/--trained-norms")

EXTENDABLE_SETTINGS = ("steps", "minutes", "patience", "evaluate_every_steps")
"""Settings that may change when a run is resumed, unless its schedule depends on the end."""


@dataclass(frozen=True)
class TrainSettings(Settings):
    """How a detector is trained; either `steps` or `minutes` is given."""

    steps: int | None = field(default=None, metadata=_POSITIVE)
    """Stop after this many steps; a larger number extends a run."""
    minutes: float | None = field(default=None, metadata=_POSITIVE)
    """Stop after this training time in minutes."""
    patience: int | None = field(default=None, metadata=_POSITIVE | shown_default("never"))
    """Stop if the box AP on val has not improved in this many evaluations."""
    batch: int = field(default=8, metadata=_POSITIVE)
    """Frames per step, over all processes."""
    mix_share: float = 0.0
    """Share of each batch that comes from the dataset that is mixed in; 0 without one."""
    accumulate: int = field(default=1, metadata=_POSITIVE)
    """Number of parts that a batch is split into, whose gradients are summed, to save memory."""
    optimizer: Literal["adamw", "sgd"] = field(default="adamw", metadata=names(("adamw", "sgd")))
    """Kind of the optimizer."""
    momentum: float = field(default=0.9, metadata=_UNDER_1)
    """Momentum of SGD."""
    learning_rate: float = field(default=1.5e-3, metadata=_POSITIVE)
    """Peak learning rate, after the warm-up."""
    schedule: Schedule = field(default="constant", metadata=_SCHEDULES)
    """Learning rate after the warm-up: `steps` multiplies it by `rate_drop` at each of
    `rate_steps`; `cosine` and `decay` lower it to `final_rate_share` of its value, along a
    cosine and a line."""
    rate_steps: tuple[int, ...] = ()
    """Steps at which the schedule `steps` lowers the rate, ascending."""
    rate_drop: float = field(default=0.1, metadata=_SHARE)
    """Factor of the rate at these steps."""
    final_rate_share: float = field(default=0.01, metadata=_SHARE)
    """Fraction of the rate at the end of `cosine` and `decay`."""
    weight_decay: float = field(default=0.05, metadata=_AT_LEAST_0)
    """Weight decay of all parameters but norms and biases."""
    warmup_steps: int = field(default=150, metadata=_POSITIVE)
    """Steps over which the rate rises linearly from 0."""
    clip_norm: float | None = field(default=10.0, metadata=_POSITIVE)
    """Maximum norm of the gradient; None for no limit."""
    ema_decay: float = field(default=0.998, metadata=_UNDER_1)
    """Decay per step of the moving average of the weights; 0 for no average."""
    evaluate_every_steps: int = field(default=1000, metadata=_EVALUATE_EVERY)
    """Steps between evaluations on val."""
    seed: int = field(default=0, metadata=limits(0, 2**63 - 1, expected="0 to 2**63 - 1"))
    """Seed of weights, order and augmentation."""
    freeze_level: int = field(default=0, metadata=limits(0, LAST_LEVEL))
    """Freeze the backbone up to the maps of stride 2**N; 0 freezes nothing, 2 is Detectron2's
    FREEZE_AT 2."""
    frozen_norms: bool = field(default=False, metadata=_FROZEN_NORMS)
    """Freeze all batch norms of the backbone."""
    frozen_steps: int = field(default=0, metadata=_AT_LEAST_0)
    """Freeze all of the backbone for this many steps at the start."""
    backbone_rate_share: float = field(default=1.0, metadata=_SHARE | option("--backbone-rate"))
    """Learning rate of the backbone, as a share of that of the other parts."""
    keep_weights: float = field(default=0.0, metadata=_AT_LEAST_0)
    """Pull of the backbone's weights towards their starting values (L2-SP, Li et al. 2018): each
    step takes away its product with the learning rate from the distance."""
    keep_features: float = field(default=0.0, metadata=_AT_LEAST_0)
    """Weight of the loss that holds the backbone's maps near those of its starting weights on the
    same pictures (Li et al. 2019, feature distillation)."""
    weight_bits: int | None = field(default=None, metadata=limits(2, 8, expected="2 to 8, or none"))
    """Round the weights to so many bits while training; 7 if an int8 export then loses too much."""
    augment: AugmentSettings = field(default_factory=AugmentSettings)
    """Augmentation of the frames."""
    sampling: SampleSettings = field(default_factory=SampleSettings)
    """Sampling of anchors and regions."""

    def _check_together(self) -> None:
        if (self.steps is None) == (self.minutes is None):
            found = f"steps is {self.steps} and minutes {self.minutes}"
            self._refuse(found, "exactly one of them")
        share = self.mix_share
        if share and not (0 < share < 1 and 0 < self.mixed_rows < self.batch):
            self._refuse(
                f"mix_share is {share:g} of a batch of {self.batch}",
                "at least one frame of each dataset in a batch",
            )
        if self.batch % self.accumulate:
            self._refuse(
                f"accumulate is {self.accumulate}", f"a divisor of the batch, {self.batch}"
            )
        if list(self.rate_steps) != sorted(set(self.rate_steps)):
            self._refuse(f"rate_steps is {self.rate_steps}", "ascending step numbers")

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
class DataSource(Settings):
    """A dataset, and the choice among its label files."""

    directory: Path = field(metadata=NOT_AN_OPTION)
    """Folder of the dataset, or a label file."""
    fold: int | None = None
    """Which fold of a dataset with several."""
    entire_tree: bool = field(default=False, metadata=option("--entire-tree"))
    """Use the labels of entire trees (SynthTree43k)."""
    mix: Path | None = None
    """Folder of a second dataset whose train split is mixed into each batch, so that the model does
    not forget what it knew; it is not evaluated."""
    certain_m: float | None = field(default=None, metadata=CERTAIN | option("--certain"))
    """Distance in metres beyond which labelled trees are ignored: they are neither trees nor
    background, in all splits. Needs labels with distance_m."""
    crowds_as_trees: bool = field(default=False, metadata=option("--crowds-as-trees"))
    """Take run lengths with iscrowd 1 as trees, as CVAT writes masks painted with a brush; by
    default only those with keypoints."""
    exact_depth: bool = field(default=False, metadata=option("--exact-depth"))
    """Learn from the exact depth of simulated frames, on which each step draws another depth
    camera; val and the dataset that is mixed in keep their own depth."""


@dataclass(frozen=True)
class Engine(Settings):
    """Hardware and speed of a training."""

    panel: ClassVar = "Machine"

    device: Literal["cpu", "cuda"] = field(
        default="cpu", metadata=names(("cpu", "cuda"), "cpu or cuda")
    )
    """Where the network runs; torchrun starts several processes."""
    precision: Literal["auto", "fp32", "bf16"] = field(
        default="auto", metadata=names(("auto", "fp32", "bf16"), "auto, fp32 or bf16")
    )
    """Numbers of the network; `auto` chooses the faster ones on this machine."""
    workers: int | None = field(
        default=None, metadata=_AT_LEAST_0 | shown_default("by the number of cores")
    )
    """Processes that prepare batches, 0 for none."""
    compile: bool = False
    """Compile backbone and pyramid by torch first, which takes minutes and pays off on GPUs."""
    cache: str | None = field(
        default=None,
        metadata=option(metavar="PATH") | shown_default(".frame-cache next to the data"),
    )
    """Folder for the decoded frames."""
    save_s: float = field(default=60.0, metadata=_POSITIVE | NOT_AN_OPTION)
    """Time between saved states, s."""
    skip_broken: bool = False
    """Leave out frames whose files are missing or broken, and broken entries of label files."""

    @property
    def device_name(self) -> str:
        """Name of the GPU, or the number of CPU cores."""
        if self.device == "cuda":
            import torch

            return str(torch.cuda.get_device_name())
        return f"{os.cpu_count()} CPU cores"

    def worker_count(self, processes: int) -> int:
        """Number of processes that prepare batches for each of `processes` training ones."""
        if self.workers is not None:
            return self.workers
        cores = os.cpu_count() or 1
        if self.device == "cuda":
            return max(1, (cores - 1) // processes)
        # On two cores a worker brings no gain, as it competes with the network
        # (benchmarks/training.py).
        return 1 if cores // processes > _FEW_CORES else 0
