"""Reproducible batches: order and augmentation depend only on seed, step and row of the batch.

Neither the number of workers nor that of processes changes the content of a step, and a resumed
run continues with the same batches.
"""

from __future__ import annotations

import atexit
import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from multiprocessing.synchronize import Event
from types import FrameType
from typing import Any

import cv2
import numpy as np
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, Sampler

from basetree.arrays import Int64
from perceptree.data import Sample, augment
from perceptree.data.cache import FrameCache
from perceptree.errors import DatasetError
from perceptree.models import ModelSpec
from perceptree.settings.training import TrainSettings
from perceptree.training.packing import PackedTargets, pack_targets

# Purposes of random number streams, a part of their seeds.
_ORDER, _AUGMENT, _SAMPLING, _MIXED_ORDER = 1, 2, 3, 4
_PREFETCH_BATCHES = 4


@dataclass(frozen=True)
class Batch:
    """The frames of one process for one part of a step.

    Attributes:
        images: uint8, (B, H, W, 3) BGR or (B, H, W) depth.
        targets: Labels of all images; None in an empty batch.
        seeds: Seed of each image for the sampling of anchors and regions.
        names: Name of each frame.
        fault: Why a frame could not be read, if so; the batch is empty then.
    """

    images: Tensor
    targets: PackedTargets | None
    seeds: list[int]
    names: list[str]
    fault: str | None = None

    def pin_memory(self) -> Batch:
        """The same in page-locked memory, which DataLoader asks for."""
        targets = None if self.targets is None else self.targets.pin_memory()
        return replace(self, images=self.images.pin_memory(), targets=targets)


Slot = tuple[int, int]
"""One frame of the training: number of the step, and row in the joint batch of that step."""


class TrainingFrames(Dataset[Any]):
    """Augmented frames by step and row.

    Args:
        frames: Cached frames.
        spec: Input of the model.
        settings: Seed, batch size, share of mixed frames and augmentation.
        mixed: Cached frames to mix in; None for none.
    """

    def __init__(
        self,
        frames: FrameCache,
        spec: ModelSpec,
        settings: TrainSettings,
        mixed: FrameCache | None = None,
    ) -> None:
        self._spec, self._settings = spec, settings
        self._frames, self._mixed = frames, mixed or frames

    def __getitem__(self, slot: Slot) -> tuple[Sample, int, str] | str:
        """Load and augment a frame.

        Returns:
            The sample, the seed for the sampling of its regions and its name; or, if a frame
            cannot be read, the error message.
        """
        step, row = slot
        settings = self._settings
        frames, number = self.frame_at(step, row)
        rng = np.random.default_rng([settings.seed, _AUGMENT, step, row])

        def other() -> Sample:
            return frames[int(rng.integers(len(frames)))]

        try:
            sample = augment(rng, frames[number], self._spec, settings.augment, other)
        except DatasetError as error:
            return str(error)
        seed = np.random.SeedSequence([settings.seed, _SAMPLING, step, row]).generate_state(1)
        return sample, int(seed[0]), frames.names[number]

    def frame_at(self, step: int, row: int) -> tuple[FrameCache, int]:
        """The frame of a slot, as its dataset and index.

        The rows of mixed frames are spread over the batch. Each epoch of each of the two datasets
        is a new permutation.
        """
        settings = self._settings
        batch, most = settings.batch, settings.mixed_rows
        before, after = row * most // batch, (row + 1) * most // batch
        if after > before:
            frames, order, position = self._mixed, _MIXED_ORDER, step * most + before
        else:
            frames, order, position = self._frames, _ORDER, step * (batch - most) + row - before
        epoch, index = divmod(position, len(frames))
        return frames, int(_permutation(settings.seed, order, epoch, len(frames))[index])


@lru_cache(maxsize=4)
def _permutation(seed: int, order: int, epoch: int, size: int) -> Int64:
    return np.random.default_rng([seed, order, epoch]).permutation(size)


class SlotSampler(Sampler[list[Slot]]):
    """Endlessly yields the slots of one process, a list for each part of a step.

    Args:
        settings: Batch size and number of parts per step.
        first_step: Step to start at.
        rank: Number of this process.
        world: Number of processes.
    """

    def __init__(self, settings: TrainSettings, first_step: int, rank: int, world: int) -> None:
        self._step, self._parts = first_step, settings.accumulate
        share = settings.batch // world
        self._own = range(rank * share, (rank + 1) * share)

    def __iter__(self) -> Iterator[list[Slot]]:
        step, size = self._step, len(self._own) // self._parts
        while True:
            for start in range(0, len(self._own), size):
                yield [(step, row) for row in self._own[start : start + size]]
            step += 1


def collate(rows: list[tuple[Sample, int, str] | str]) -> Batch:
    """Combine samples into a batch; with an error message among them, into a faulty batch."""
    samples = []
    for row in rows:
        if isinstance(row, str):
            return Batch(torch.empty(0), None, [], [], row)
        samples.append(row)
    images = torch.from_numpy(np.stack([sample.image for sample, _, _ in samples]))
    return Batch(
        images,
        pack_targets([sample for sample, _, _ in samples]),
        [seed for _, seed, _ in samples],
        [name for _, _, name in samples],
    )


def make_loader(
    frames: TrainingFrames, sampler: SlotSampler, workers: int, pinned: bool
) -> DataLoader[Any]:
    """Make a loader of batches.

    Args:
        frames: Frames by slot.
        sampler: Slots of the batches.
        workers: Processes that prepare batches ahead; 0 prepares them in this process.
        pinned: Whether batches are put in page-locked memory, for copying to a GPU.
    """
    ahead = {"prefetch_factor": _PREFETCH_BATCHES, "persistent_workers": True} if workers else {}
    ending = multiprocessing.Event()
    if workers:
        atexit.register(ending.set)  # runs before multiprocessing ends the workers by SIGTERM
    return DataLoader(
        frames,
        batch_sampler=sampler,
        collate_fn=collate,
        num_workers=workers,
        worker_init_fn=partial(_start_worker, ending),
        pin_memory=pinned,
        **ahead,  # type: ignore[arg-type]
    )


def prefetch_one(batches: Iterator[Batch]) -> Iterator[Batch]:
    """Yield the same batches, preparing the next one in a thread of this process."""
    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(next, batches)
        while True:
            batch = coming.result()
            coming = thread.submit(next, batches)
            yield batch


def _start_worker(ending: Event, worker: int) -> None:
    """Use one thread, and leave Ctrl-C and SIGTERM to the main process until it ends itself."""

    def end(number: int, frame: FrameType | None) -> None:
        if ending.is_set():
            os._exit(0)

    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, end)
    torch.set_num_threads(1)
    cv2.setNumThreads(0)


class SeededDraws:
    """Random numbers for each image of a batch, from the image's own seed.

    Args:
        seeds: Seed of each image.
    """

    def __init__(self, seeds: list[int]) -> None:
        self._seeds, self._calls = seeds, 0
        self._generator = torch.Generator()

    def __call__(self, shape: tuple[int, int], device: torch.device) -> Tensor:
        """Draw (B, N) uniform numbers from 0 to 1, different ones in each call."""
        self._calls += 1
        rows = []
        for seed in self._seeds[: shape[0]]:
            self._generator.manual_seed(seed * 16 + self._calls)
            rows.append(torch.rand(shape[1], generator=self._generator))
        return torch.stack(rows).to(device)
