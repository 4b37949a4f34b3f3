"""Check the state of an optimizer before a training takes it over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

# What the optimizers remember of each parameter, besides the number of steps.
_REMEMBERED = {"AdamW": ("exp_avg", "exp_avg_sq"), "SGD": ("momentum_buffer",)}
_STEP, _SQUARE = "step", "exp_avg_sq"
_MOST_STEPS = 10**12


def check_optimizer_state(optimizer: torch.optim.Optimizer, state: Mapping[str, Any]) -> None:
    """Check that a state is one of this optimizer: its groups, numbers and tensors.

    Args:
        optimizer: The optimizer, AdamW or SGD, that is to load the state.
        state: A state that may be broken.

    Raises:
        ValueError: If a group, a number or a tensor is none that the optimizer writes.
    """
    own = optimizer.state_dict()["param_groups"]
    groups, remembered = state.get("param_groups"), state.get("state")
    if not isinstance(groups, list) or not isinstance(remembered, dict) or len(groups) != len(own):
        raise ValueError(
            f"the optimizer has no {len(own)} groups of parameters with their state, as with"
            " another --backbone-rate"
        )
    for group, like in zip(groups, own, strict=True):
        _check_group(group, like)
    parameters = [one for group in optimizer.param_groups for one in group["params"]]
    for number, values in remembered.items():
        if type(number) is not int or not 0 <= number < len(parameters):
            raise ValueError(f"the optimizer has a state of parameter {number!r:.100}")
        if not isinstance(values, dict):
            raise ValueError(f"the optimizer's state of parameter {number} is none")
        if values:
            _check_remembered(type(optimizer).__name__, number, values, parameters[number])


def _check_group(group: Any, like: Mapping[str, Any]) -> None:
    """Check that a group has the same parameters and switches, and numbers where there are some."""
    if not isinstance(group, dict) or group.get("params") != like["params"]:
        raise ValueError(
            "the optimizer's groups have other parameters, as with another --freeze-level or"
            " --backbone-rate"
        )
    for name, value in like.items():
        found = group.get(name, value)
        if isinstance(value, bool) or value is None or name == "params":
            fits = found is value or name == "params"
        elif isinstance(value, tuple | list):
            fits = isinstance(found, tuple | list) and len(found) == len(value)
            fits = fits and all(_is_number(one, most=1) for one in found)
        else:
            fits = _is_number(found)
        if not fits:
            raise ValueError(f"the optimizer's {name} is {found!r:.100}, expected one like {value}")


def _check_remembered(kind: str, number: int, values: dict[str, Any], parameter: Tensor) -> None:
    step = values.get(_STEP, 0)
    count = step.item() if isinstance(step, Tensor) and step.numel() == 1 else step
    if not _is_number(count, most=_MOST_STEPS):
        raise ValueError(f"the optimizer's step of parameter {number} is {step!r:.100}")
    for name in _REMEMBERED[kind]:
        value = values.get(name)
        if value is None and kind == "SGD":
            continue
        if not isinstance(value, Tensor) or value.shape != parameter.shape:
            shape = tuple(value.shape) if isinstance(value, Tensor) else type(value).__name__
            raise ValueError(
                f"the optimizer's {name} of parameter {number} has shape {shape}, expected"
                f" {tuple(parameter.shape)}"
            )
        if value.is_complex() or value.is_sparse or not value.isfinite().all():
            raise ValueError(f"the optimizer's {name} of parameter {number} has no finite numbers")
        if name == _SQUARE and value.numel() and value.min() < 0:
            raise ValueError(f"the optimizer's {name} of parameter {number} is below 0")
    if kind == "AdamW" and _STEP not in values:
        raise ValueError(f"the optimizer has no step of parameter {number}")


def _is_number(value: Any, most: float = 1e300) -> bool:
    """Whether a value is a number of at least 0 that is not too large."""
    return isinstance(value, int | float) and not isinstance(value, bool) and 0 <= value <= most
