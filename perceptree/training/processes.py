"""The processes of a training that torchrun started, and what they say to each other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from types import MethodType
from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm

from perceptree.errors import SettingsError

_TIMEOUT = timedelta(minutes=10)


class Processes:
    """One process by itself, or one of several that learn from a joint batch."""

    def __init__(self, rank: int = 0, world: int = 1) -> None:
        self.rank, self.world = rank, world

    @property
    def leads(self) -> bool:
        """Whether this process writes files and reports."""
        return self.rank == 0

    def share(self, count: Tensor) -> Tensor:
        """A count of this process -> the mean count of all."""
        if self.world == 1:
            return count
        total = count.detach().to(torch.float32, copy=True)
        dist.all_reduce(total)
        return total / self.world

    def mean(self, values: Tensor) -> Tensor:
        """The mean of all processes' ``values``, the same in each."""
        return self.share(values)

    def agree(self, value: float) -> float:
        """The lead's value, in all processes."""
        if self.world == 1:
            return value
        told = torch.tensor([value], dtype=torch.float64)
        if dist.get_backend() == "nccl":
            told = told.cuda()
        dist.broadcast(told, 0)
        return float(told.item())

    def tell(self, value: Any) -> Any:
        """The lead's value of any kind, in all processes."""
        if self.world == 1:
            return value
        told = [value]
        dist.broadcast_object_list(told, 0)
        return told[0]

    def wait(self) -> None:
        """Go on when all have come here."""
        if self.world > 1:
            dist.barrier()


@contextmanager
def joined(device: str) -> Iterator[Processes]:
    """The processes that torchrun started, joined by gloo or, on GPUs, nccl.

    Raises SettingsError where they cannot find each other.
    """
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world == 1:
        yield Processes()
        return
    if device == "cuda":
        torch.cuda.set_device(int(os.environ.get("LOCAL_RANK", "0")))
    try:
        dist.init_process_group("nccl" if device == "cuda" else "gloo", timeout=_TIMEOUT)
    except (RuntimeError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise SettingsError(
            f"WORLD_SIZE is {world}, but the processes do not find each other ({reason}):"
            " expected a start by torchrun"
        ) from error
    try:
        yield Processes(dist.get_rank(), world)
    finally:
        dist.destroy_process_group()


def synchronise_norms(model: nn.Module) -> None:
    """Have the batch norms take their statistics over the joint batch of all processes.

    As torch's SyncBatchNorm, which needs GPUs and does not know the norms of the timm library.
    """
    for module in model.modules():
        if isinstance(module, _BatchNorm):
            module.forward = MethodType(_joint_norm, module)  # type: ignore[method-assign]


class _Sum(torch.autograd.Function):
    """The sum over all processes; its gradient is the sum of theirs."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        """Any shape, the same in all processes."""
        total = x.detach().clone()
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        """The gradient in all processes -> their sum."""
        total = gradient.clone()
        dist.all_reduce(total)
        return total


def _joint_mean(x: Tensor) -> Tensor:
    """The mean of all processes' ``x``, with its gradient."""
    total: Tensor = _Sum.apply(x)
    return total / dist.get_world_size()


def _joint_norm(norm: Any, x: Tensor) -> Tensor:
    if not norm.training:
        forward: Tensor = type(norm).forward(norm, x)
        return forward
    x32 = x.float()
    # Means of the processes' means: their batches are of one size.
    mean = _joint_mean(x32.mean((0, 2, 3)))
    apart = (x32 - mean[:, None, None]).square()
    variance = _joint_mean(apart.mean((0, 2, 3)))
    with torch.no_grad():
        count = x.numel() / x.shape[1] * dist.get_world_size()
        norm.running_mean.lerp_(mean, norm.momentum)
        norm.running_var.lerp_(variance * count / (count - 1), norm.momentum)
        norm.num_batches_tracked += 1
    scale = norm.weight * torch.rsqrt(variance + norm.eps)
    shift = norm.bias - mean * scale
    made: Tensor = (x32 * scale[:, None, None] + shift[:, None, None]).to(x.dtype)
    if hasattr(norm, "act"):  # timm's norm with an activation
        made = norm.act(norm.drop(made))
    return made
