"""Batches in an order, and with an augmentation, that follow from seed, step and slot alone.

So neither the number of workers nor that of processes changes what a step learns from, and a
resumed run goes on with the batch it would have had.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from perceptree.data import Sample, augment
from perceptree.data.cache import FrameCache
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec, TreeTargets
from perceptree.training.settings import TrainSettings

_ORDER, _AUGMENT, _SAMPLING = 1, 2, 3  # what a stream of random numbers is for
_AHEAD = 4


@dataclass(frozen=True)
class Batch:
    """What one process learns from in one part of a step.

    ``images`` uint8 (B, H, W) or (B, H, W, 3), a tree's ``targets`` per image, ``seeds`` (B,) of
    the choice of regions, ``names`` of the frames. ``fault`` says why there is no batch.
    """

    images: Tensor
    targets: list[TreeTargets]
    seeds: list[int]
    names: list[str]
    fault: str | None = None


Slot = tuple[int, int]
"""A place in the training: number of the step, place in the step's joint batch."""


class TrainingFrames(Dataset[Any]):
    """Augmented frames by their place in the training."""

    def __init__(self, frames: FrameCache, spec: ModelSpec, settings: TrainSettings) -> None:
        self._frames, self._spec, self._settings = frames, spec, settings

    def __getitem__(self, slot: Slot) -> tuple[Sample, int, str] | str:
        """A sample, the seed of its regions and its name; a string says what is wrong with it."""
        step, place = slot
        settings = self._settings
        number = self.frame_at(step * settings.batch + place)
        rng = np.random.default_rng([settings.seed, _AUGMENT, step, place])

        def other() -> Sample:
            return self._frames[int(rng.integers(len(self._frames)))]

        try:
            sample = augment(rng, self._frames[number], self._spec, settings.augment, other)
        except DatasetError as error:
            return str(error)
        seed = np.random.SeedSequence([settings.seed, _SAMPLING, step, place]).generate_state(1)
        return sample, int(seed[0]), self._frames.names[number]

    def frame_at(self, position: int) -> int:
        """The frame at a position of the endless sequence: every epoch is a new permutation."""
        epoch, place = divmod(position, len(self._frames))
        return int(_permutation(self._settings.seed, epoch, len(self._frames))[place])


@lru_cache(maxsize=2)
def _permutation(seed: int, epoch: int, size: int) -> NDArray[np.int64]:
    return np.random.default_rng([seed, _ORDER, epoch]).permutation(size)


class SlotSampler(Sampler[list[Slot]]):
    """The slots of one process from a step on, for ever, a list for each part of a step."""

    def __init__(self, settings: TrainSettings, first_step: int, rank: int, world: int) -> None:
        self._step, self._parts = first_step, settings.accumulate
        share = settings.batch // world
        self._own = range(rank * share, (rank + 1) * share)

    def __iter__(self) -> Iterator[list[Slot]]:
        step, size = self._step, len(self._own) // self._parts
        while True:
            for start in range(0, len(self._own), size):
                yield [(step, place) for place in self._own[start : start + size]]
            step += 1


def collate(rows: list[tuple[Sample, int, str] | str]) -> Batch:
    """Samples of one part of a step as a batch."""
    samples = []
    for row in rows:
        if isinstance(row, str):
            return Batch(torch.empty(0), [], [], [], row)
        samples.append(row)
    images = torch.from_numpy(np.stack([sample.image for sample, _, _ in samples]))
    return Batch(
        images,
        [sample.targets() for sample, _, _ in samples],
        [seed for _, seed, _ in samples],
        [name for _, _, name in samples],
    )


def make_loader(
    frames: TrainingFrames, sampler: SlotSampler, workers: int, pinned: bool
) -> DataLoader[Any]:
    """Batches of ``sampler``, prepared by ``workers`` processes, a few ahead; 0: by the caller."""
    ahead = {"prefetch_factor": _AHEAD, "persistent_workers": True} if workers else {}
    return DataLoader(
        frames,
        batch_sampler=sampler,
        collate_fn=collate,
        num_workers=workers,
        worker_init_fn=_start_worker,
        pin_memory=pinned,
        **ahead,  # type: ignore[arg-type]
    )


def one_ahead(batches: Iterator[Batch]) -> Iterator[Batch]:
    """The same batches, each prepared in a thread of this process while a step computes."""
    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(next, batches)
        while True:
            batch = coming.result()
            coming = thread.submit(next, batches)
            yield batch


def _start_worker(number: int) -> None:
    """One thread each, and a Ctrl-C is the trainer's affair."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    torch.set_num_threads(1)
    cv2.setNumThreads(0)


class SlotDraws:
    """Random numbers for each image of a batch, from its own seed."""

    def __init__(self, seeds: list[int]) -> None:
        self._seeds, self._calls = seeds, 0
        self._generator = torch.Generator()

    def __call__(self, shape: tuple[int, int], device: torch.device) -> Tensor:
        """(B, N) uniform numbers, other ones in each call."""
        self._calls += 1
        rows = []
        for seed in self._seeds[: shape[0]]:
            self._generator.manual_seed(seed * 16 + self._calls)
            rows.append(torch.rand(shape[1], generator=self._generator))
        return torch.stack(rows).to(device)
