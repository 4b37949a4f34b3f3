"""Communication between the processes of a distributed training that torchrun started."""

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

from basetree.errors import SettingsError

_TIMEOUT = timedelta(minutes=10)
_LONGEST_WORK = timedelta(days=7)
"""How long processes wait for what one of them does alone: the frame cache and evaluations."""


class Processes:
    """A single process, or one of several that train on a joint batch.

    Attributes:
        rank: Number of this process.
        world: Number of processes.
        waiting: The group in which they wait for what one of them does alone; None for all.
    """

    def __init__(self, rank: int = 0, world: int = 1, waiting: Any = None) -> None:
        self.rank, self.world, self.waiting = rank, world, waiting

    @property
    def is_lead(self) -> bool:
        """Whether this is the process of rank 0, which writes files and reports."""
        return self.rank == 0

    def mean(self, values: Tensor) -> Tensor:
        """Mean over all processes of `values`; without gradient."""
        if self.world == 1:
            return values
        total = values.detach().to(torch.float32, copy=True)
        dist.all_reduce(total)
        return total / self.world

    def broadcast_number(self, value: float) -> float:
        """Return the number of the process of rank 0 in all processes."""
        if self.world == 1:
            return value
        shared = torch.tensor([value], dtype=torch.float64)
        if dist.get_backend() == "nccl":
            shared = shared.cuda()
        dist.broadcast(shared, 0)
        return float(shared.item())

    def broadcast(self, value: Any) -> Any:
        """Return the object of the process of rank 0, which must be picklable, in all processes."""
        if self.world == 1:
            return value
        shared = [value]
        dist.broadcast_object_list(shared, 0, group=self.waiting)
        return shared[0]

    def barrier(self) -> None:
        """Wait until all processes have reached this call."""
        if self.world > 1:
            dist.barrier(group=self.waiting)


@contextmanager
def process_group(device: str) -> Iterator[Processes]:
    """Join the processes that torchrun started, by gloo or, on GPUs, by NCCL.

    Args:
        device: `cpu` or `cuda`.

    Yields:
        The processes; a single one if torchrun did not start this process.

    Raises:
        SettingsError: If the processes cannot connect.
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
            f"WORLD_SIZE is {world}, but the processes cannot connect ({reason}):"
            " expected a start by torchrun"
        ) from error
    try:
        waiting = dist.new_group(timeout=_LONGEST_WORK, backend="gloo")
        yield Processes(dist.get_rank(), world, waiting)
    finally:
        dist.destroy_process_group()


def synchronise_norms(model: nn.Module) -> None:
    """Make the batch norms compute their statistics over the joint batch of all processes.

    Like torch's SyncBatchNorm, which supports neither CPUs nor timm's batch norms.

    Args:
        model: The model to change.
    """
    for module in model.modules():
        if isinstance(module, _BatchNorm):
            module.forward = MethodType(_joint_norm, module)  # type: ignore[method-assign]


class _Sum(torch.autograd.Function):
    """Sum over all processes, with the sum of their gradients as gradient."""

    @staticmethod
    def forward(ctx: Any, x: Tensor) -> Tensor:
        """Sum tensors of the same shape over all processes."""
        total = x.detach().clone()
        dist.all_reduce(total)
        return total

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        """Sum the gradients over all processes."""
        total = gradient.clone()
        dist.all_reduce(total)
        return total


def _joint_mean(x: Tensor) -> tuple[Tensor, Tensor]:
    """Mean of each channel of (N, C, H, W) over all processes, with gradient; 0 without values.

    Processes may have different numbers of images, or none: of a network of both inputs, those
    that show nothing are left out.

    Returns:
        (C,) means, and (1,) the joint number of values of a channel.
    """
    own = x.new_tensor([x.numel() / x.shape[1]])
    total: Tensor = _Sum.apply(torch.cat((x.sum((0, 2, 3)), own)))
    count = total[-1:].detach()
    return total[:-1] / count.clamp(min=1.0), count


def _joint_norm(norm: Any, x: Tensor) -> Tensor:
    if not norm.training:
        forward: Tensor = type(norm).forward(norm, x)
        return forward
    x32 = x.float()
    mean, count = _joint_mean(x32)
    variance, _ = _joint_mean((x32 - mean[:, None, None]).square())
    with torch.no_grad():
        share = norm.momentum * (count > 0)
        norm.running_mean.lerp_(mean, share)
        norm.running_var.lerp_(variance * count / (count - 1).clamp(min=1.0), share)
        norm.num_batches_tracked += 1
    scale = norm.weight * torch.rsqrt(variance + norm.eps)
    shift = norm.bias - mean * scale
    made: Tensor = (x32 * scale[:, None, None] + shift[:, None, None]).to(x.dtype)
    if hasattr(norm, "act"):  # timm's norm with an activation
        made = norm.act(norm.drop(made))
    return made
