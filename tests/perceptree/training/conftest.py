"""Fixtures of the training tests: a narrow network and short settings."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from perceptree.models import ModelSpec, load_checkpoint, make_spec
from perceptree.training import Status, TrainSettings


@pytest.fixture
def narrow() -> Callable[..., ModelSpec]:
    """A narrow network for frames of 128x64 px."""

    def make(modality: Any = "depth", **changes: Any) -> ModelSpec:
        return make_spec(
            "edge-n",
            modality,
            64,
            128,
            fpn_width=16,
            box_head_width=16,
            mask_head_widths=(8,),
            keypoint_head_widths=(8,),
            **changes,
        )

    return make


@pytest.fixture
def plan() -> Callable[..., TrainSettings]:
    """Settings for a few steps."""

    def make(**changes: Any) -> TrainSettings:
        values: dict[str, Any] = {
            "steps": 4,
            "batch": 2,
            "warmup_steps": 2,
            "evaluate_every_steps": 100,
        }
        if "minutes" in changes:
            values["steps"] = None
        return TrainSettings(**values | changes)

    return make


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
