"""Save and read the state of a training."""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from basetree.files.writing import replacing
from perceptree.errors import CheckpointError
from perceptree.models.checkpoint import check_values
from perceptree.models.weights.archives import check_archive

STATE_NAME = "state.pt"
_VERSION = 1
_LONGEST_REASON = 300
_MOST_STEPS = 10**12
_STEPS = ("step", "first_step", "stale", "evaluated_at")
_TIMES = ("elapsed_s", "waited_s")
_PRECISIONS = ("fp32", "bf16")
_KEYS = ("model", "average", "optimizer", "precision", *_STEPS, *_TIMES, "means", "best")

Identity = Mapping[str, Mapping[str, Any]]
"""What must be equal to resume a state: JSON values by group and name."""


def write_state(path: Path, state: Mapping[str, Any], identity: Identity) -> None:
    """Write a state atomically: on an error an existing file remains unchanged.

    Args:
        path: File to write.
        state: Values that `torch.save` can store.
        identity: What the training must have in common with the state to resume it.

    Raises:
        CheckpointError: If the file cannot be written.
    """
    record = {"version": _VERSION, "identity": json.dumps(identity)}
    try:
        with replacing(path) as file:
            torch.save({**state, **record}, file)
    except (OSError, RuntimeError) as error:  # torch reports a full disk as RuntimeError
        raise CheckpointError(f"{path}: cannot be written ({_reason(error)})") from error


def _reason(error: BaseException) -> str:
    """Why writing failed: the system's reason if there is one."""
    cause: BaseException | None = error
    while cause is not None and not isinstance(cause, OSError):
        cause = cause.__cause__ or cause.__context__
    return str(error) if cause is None else str(cause.strerror or cause)


def read_identity(run: Path) -> dict[str, dict[str, Any]]:
    """Read what a run's state must have in common with a training that resumes it.

    Args:
        run: Folder of the run.

    Raises:
        CheckpointError: If there is no state, or it is unreadable or none.
    """
    return _read(run / STATE_NAME)[1]


def read_state(path: Path, identity: Identity, defaults: Identity | None = None) -> dict[str, Any]:
    """Read what `write_state` wrote.

    Args:
        path: File to read.
        identity: Values that must equal the stored ones, by group and name.
        defaults: Values to assume for those that the stored identity lacks, as states of older
            versions do.

    Raises:
        CheckpointError: If the file is unreadable or no training state, if a value of it is out of
            range, or if its identity differs.
    """
    state, found = _read(path)
    wanted = json.loads(json.dumps(identity))
    filled = json.loads(json.dumps(defaults or {}))
    for group in wanted:
        known = filled.get(group, {}) | found.get(group, {})
        differing = [
            f"{name} was {known.get(name)!r}, is {wanted[group].get(name)!r}"
            for name in sorted(known.keys() | wanted[group].keys())
            if known.get(name) != wanted[group].get(name)
        ]
        if differing:
            raise CheckpointError(
                f"{path}: belongs to a training with other {group}: {'; '.join(differing[:3])};"
                " expected the same to resume it, or another output folder"
            )
    return state


def _read(path: Path) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
    """A state and its identity."""
    if not path.is_file():
        raise CheckpointError(
            f"{path.parent}: has no {path.name}, expected the folder of a training run"
        )
    try:
        check_archive(path)
        state = torch.load(path, weights_only=True, map_location="cpu")
        return dict(state), _checked(state)
    except Exception as error:  # torch has no common error for broken files
        reason = str(error).partition("\n")[0][:_LONGEST_REASON] or type(error).__name__
        raise CheckpointError(f"{path}: not a readable training state ({reason})") from error


def _checked(state: Any) -> dict[str, dict[str, Any]]:
    """Check the types and ranges of a state's values, and return its identity.

    Raises:
        ValueError: If a value is missing or none that `write_state` writes.
    """
    if not isinstance(state, dict):
        raise ValueError("it holds no values by name")
    missing = [name for name in (*_KEYS, "identity") if name not in state]
    if missing:
        raise ValueError(f"{missing[0]} is missing")
    for name in _STEPS:
        if type(state[name]) is not int or not -1 <= state[name] <= _MOST_STEPS:
            raise ValueError(f"{name} is {state[name]!r:.100}, expected a number of steps")
    if state["first_step"] > state["step"]:
        raise ValueError(f"first_step is {state['first_step']}, after step {state['step']}")
    for name in _TIMES:
        if not _is_finite(state[name]) or state[name] < 0:
            raise ValueError(f"{name} is {state[name]!r:.100}, expected seconds")
    _check_weights(state)
    identity = json.loads(state["identity"])
    if not isinstance(identity, dict) or not all(isinstance(v, dict) for v in identity.values()):
        raise ValueError("identity is not an object of objects")
    return identity


def _check_weights(state: Mapping[str, Any]) -> None:
    """Check the types of weights, optimizer and metrics, and that all numbers are finite.

    Raises:
        ValueError: If one has another type.
        CheckpointError: If a weight is not finite.
    """
    means, best = state["means"], state["best"]
    if not isinstance(means, dict) or not all(map(_is_finite, means.values())):
        raise ValueError("means are no finite numbers by name")
    if best is not None and (not isinstance(best, dict) or not _is_finite(best.get("box_ap"))):
        raise ValueError("best has no box_ap")
    if best is not None and not all(map(_is_metric, best.values())):
        raise ValueError("best holds what is no metric")
    for name in ("model", "average", "start"):
        weights = state.get(name)
        if weights is None and name != "model":
            continue
        if not isinstance(weights, dict) or not all(
            isinstance(value, torch.Tensor) for value in weights.values()
        ):
            raise ValueError(f"{name} does not hold tensors by name")
        check_values(name, weights)
    if not isinstance(state["optimizer"], dict) or state["precision"] not in _PRECISIONS:
        raise ValueError("optimizer or precision is of another type")


def _is_metric(value: Any) -> bool:
    """Whether a value is a finite number, None, or an object of such."""
    if isinstance(value, dict):
        return all(one is None or _is_finite(one) for one in value.values())
    return value is None or _is_finite(value)


def _is_finite(value: Any) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and abs(value) <= sys.float_info.max
