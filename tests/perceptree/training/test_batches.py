"""The content of a step depends only on seed, step and slot, not on who prepares it."""

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from perceptree.data import Sample, read_split
from perceptree.data.cache import open_cache
from perceptree.training.batches import (
    Batch,
    SeededDraws,
    SlotSampler,
    TrainingFrames,
    collate,
    make_loader,
    prefetch_one,
)
from perceptree.training.packing import pack_targets

Make = Callable[..., Any]

CPU = torch.device("cpu")


@pytest.fixture
def frames(posts: Path, tmp_path: Path, narrow: Make, plan: Make) -> TrainingFrames:
    cache = open_cache(read_split(posts, "train"), narrow(), tmp_path / "cache")
    return TrainingFrames(cache, narrow(), plan(batch=4))


def first_batches(frames: TrainingFrames, sampler: SlotSampler, workers: int) -> list[Batch]:
    loader = iter(make_loader(frames, sampler, workers, pinned=False))
    return [next(loader) for _ in range(3)]


def assert_equal(one: Batch, two: Batch) -> None:
    assert (one.names, one.seeds) == (two.names, two.seeds)
    assert torch.equal(one.images, two.images)
    assert one.targets is not None
    assert two.targets is not None
    pairs = zip(*(batch.targets.unpack(CPU) for batch in (one, two)), strict=True)
    for first, second in pairs:
        assert torch.equal(first.boxes, second.boxes)
        assert torch.equal(first.keypoints, second.keypoints)
        assert first.masks is not None
        assert second.masks is not None
        assert torch.equal(first.masks, second.masks)


def test_neither_workers_nor_processes_change_a_batch(frames: TrainingFrames, plan: Make) -> None:
    settings = plan(batch=4)
    alone = first_batches(frames, SlotSampler(settings, 0, 0, 1), workers=0)
    helped = first_batches(frames, SlotSampler(settings, 0, 0, 1), workers=2)
    for one, two in zip(alone, helped, strict=True):
        assert_equal(one, two)
    halves = [first_batches(frames, SlotSampler(settings, 0, rank, 2), 0) for rank in (0, 1)]
    for step, whole in enumerate(alone):
        assert halves[0][step].names + halves[1][step].names == whole.names
        joined = torch.cat([half[step].images for half in halves])
        assert torch.equal(joined, whole.images)


def test_the_next_batch_is_prepared_while_a_step_computes(
    frames: TrainingFrames, plan: Make
) -> None:
    settings, begun = plan(batch=4), [threading.Event() for _ in range(4)]

    def noted() -> Iterator[Batch]:
        loader = iter(make_loader(frames, SlotSampler(settings, 0, 0, 1), 0, pinned=False))
        for event in begun:
            event.set()
            yield next(loader)

    ahead = prefetch_one(noted())
    alone = first_batches(frames, SlotSampler(settings, 0, 0, 1), workers=0)
    for number, batch in enumerate(alone):
        assert_equal(next(ahead), batch)
        assert begun[number + 1].wait(10)


def test_a_later_start_goes_on_with_the_same_batches(frames: TrainingFrames, plan: Make) -> None:
    settings = plan(batch=4)
    first = first_batches(frames, SlotSampler(settings, 0, 0, 1), workers=0)
    later = first_batches(frames, SlotSampler(settings, 2, 0, 1), workers=0)
    assert_equal(first[2], later[0])
    assert not torch.equal(first[0].images, first[1].images)


def test_every_epoch_shows_every_frame_in_another_order(frames: TrainingFrames) -> None:
    places = [frames.frame_at(*divmod(position, 4))[1] for position in range(18)]
    epochs = [places[start : start + 6] for start in (0, 6, 12)]
    assert [sorted(epoch) for epoch in epochs] == [list(range(6))] * 3
    assert len({tuple(epoch) for epoch in epochs}) == 3


def test_a_damaged_frame_becomes_the_fault_of_its_batch(
    frames: TrainingFrames, posts: Path, tmp_path: Path
) -> None:
    pictures = tmp_path / "cache/images.bin"
    pictures.write_bytes(bytes(pictures.stat().st_size))
    batch = collate([frames[0, 0], frames[0, 1]])
    assert batch.fault is not None
    assert "does not match its checksum" in batch.fault


def test_an_images_draws_do_not_depend_on_the_images_beside_it() -> None:
    cpu = torch.device("cpu")
    both, one = SeededDraws([7, 8]), SeededDraws([8])
    for columns in (50, 60):
        pair, single = both((2, columns), cpu), one((1, columns + 3), cpu)
        assert torch.equal(pair[1], single[0, :columns])
        assert not torch.equal(pair[0], pair[1])
        assert 0 <= pair.min() < 0.2 < 0.8 < pair.max() < 1
    again = SeededDraws([7, 8])
    assert not np.allclose(again((2, 50), cpu), both((2, 50), cpu))


def test_packed_labels_are_those_of_the_frames() -> None:
    rng = np.random.default_rng(3)
    samples = [
        Sample(
            np.zeros((9, 21, 3), np.uint8),
            rng.random((count, 4)),
            rng.random((count, 5, 3)),
            rng.random((count, 9, 21)) < 0.5,
            rng.random((regions, 4)),
        )
        for count, regions in ((2, 0), (0, 3), (3, 1))
    ]
    found = pack_targets(samples).unpack(CPU)
    for sample, target in zip(samples, found, strict=True):
        wanted = sample.targets()
        for name in ("boxes", "keypoints", "masks", "ignored"):
            assert torch.equal(getattr(target, name), getattr(wanted, name))
    packed = pack_targets(samples).masks
    assert packed is not None
    assert packed.nbytes == 5 * 9 * 3
