"""Fixtures of the training tests: a narrow network and short settings."""

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from narrow_networks import narrow_spec, short_plan

from perceptree.models import ModelSpec, load_checkpoint
from perceptree.training import Status, TrainSettings


@pytest.fixture
def narrow() -> Callable[..., ModelSpec]:
    """A narrow network for frames of 128x64 px."""
    return narrow_spec


@pytest.fixture
def plan() -> Callable[..., TrainSettings]:
    """Settings for a few steps."""
    return short_plan


@pytest.fixture
def weights() -> Callable[[Path], dict[str, torch.Tensor]]:
    """Read the weights of a checkpoint."""
    return lambda path: load_checkpoint(path)[0].state_dict()


@pytest.fixture
def interrupt_at() -> Callable[[int], Callable[[Status], None]]:
    """A progress callback that interrupts after a step."""

    def make(step: int) -> Callable[[Status], None]:
        def progress(status: Status) -> None:
            if status.step == step:
                raise KeyboardInterrupt

        return progress

    return make
