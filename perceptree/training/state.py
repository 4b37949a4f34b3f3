"""The state of a training on disk, and an interrupt that waits for the end of a step."""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import torch

from perceptree.errors import CheckpointError

_KEYS = ("model", "average", "optimizer", "step", "elapsed_s", "evaluated", "means", "best")


def write_state(path: Path, state: Mapping[str, Any], identity: Mapping[str, Any]) -> None:
    """Write ``state`` with what it belongs to (JSON values), all or nothing.

    Raises CheckpointError where it cannot be written; a file that was there stays whole.
    """
    beside = path.with_name(path.name + ".part")
    record = {name: json.dumps(value, sort_keys=True) for name, value in identity.items()}
    try:
        torch.save({**state, "identity": record}, beside)
        os.replace(beside, path)
    except (OSError, RuntimeError) as error:  # torch reports a full disk as RuntimeError
        raise CheckpointError(f"{path}: cannot be written ({error})") from error
    finally:
        with contextlib.suppress(OSError):
            beside.unlink(missing_ok=True)


def read_state(path: Path, identity: Mapping[str, Any]) -> dict[str, Any]:
    """Read what :func:`write_state` wrote.

    Raises CheckpointError for another kind of file, or where ``identity`` is not the written one.
    """
    try:
        state = torch.load(path, weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise CheckpointError(f"{path}: not a readable training state ({reason})") from error
    found = state.get("identity") if isinstance(state, dict) else None
    if not isinstance(found, dict) or not set(_KEYS) <= set(state):
        raise CheckpointError(f"{path}: not a training state of this project")
    for name, value in identity.items():
        if found.get(name) != json.dumps(value, sort_keys=True):
            raise CheckpointError(
                f"{path}: belongs to a training with other {name}; expected the same ones to go"
                " on, or another output folder"
            )
    return dict(state)


@contextlib.contextmanager
def interrupt_afterwards() -> Iterator[None]:
    """Let a Ctrl-C within the block raise KeyboardInterrupt at its end; a second one at once.

    Outside the main thread, where Python delivers no signals, the block runs as it is.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    pressed = False

    def remember(number: int, frame: FrameType | None) -> None:
        nonlocal pressed
        if pressed:
            raise KeyboardInterrupt
        pressed = True

    before = signal.signal(signal.SIGINT, remember)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed:
        raise KeyboardInterrupt
