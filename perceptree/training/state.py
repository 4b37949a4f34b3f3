"""Save and read the state of a training."""

from __future__ import annotations

import json
import pickle
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from calib.writing import replacing
from perceptree.errors import CheckpointError

STATE_NAME = "state.pt"
_VERSION = 1
_KEYS = ("model", "optimizer", "step", "first_step", "elapsed_s", "means", "best", "stale")

Identity = Mapping[str, Mapping[str, Any]]
"""What must be equal to resume a state: JSON values by group and name."""


def write_state(path: Path, state: Mapping[str, Any], identity: Identity) -> None:
    """Write a state atomically: on an error an existing file remains unchanged.

    Args:
        path: File to write.
        state: Values that ``torch.save`` can store.
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


def read_state(path: Path, identity: Identity, defaults: Identity | None = None) -> dict[str, Any]:
    """Read what :func:`write_state` wrote.

    Args:
        path: File to read.
        identity: Values that must equal the stored ones, by group and name.
        defaults: Values to assume for those that the stored identity lacks, as states of older
            versions do.

    Raises:
        CheckpointError: If the file is unreadable or no training state, or a value differs.
    """
    try:
        state = torch.load(path, weights_only=True, map_location="cpu")
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CheckpointError(f"{path}: not a readable training state ({reason})") from error
    if not isinstance(state, dict) or not set(_KEYS) <= set(state) or "identity" not in state:
        raise CheckpointError(f"{path}: not a training state of this project")
    found = json.loads(state["identity"])
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
    return dict(state)
