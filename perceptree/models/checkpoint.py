"""Checkpoints: weights, model spec and training record in one safetensors file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from calib.file_names import is_utf8
from calib.writing import replacing
from perceptree.errors import CheckpointError
from perceptree.models.detector import TreeRCNN
from perceptree.models.spec import ModelSpec, SpecError

SCHEMA = "perceptree.checkpoint/1"
METADATA_KEY = "perceptree"


def save_checkpoint(path: str | Path, model: TreeRCNN, training: dict[str, Any]) -> None:
    """Write a checkpoint atomically: on an error no partial file remains.

    Args:
        path: File to write; missing parent folders are made.
        model: The network, whose spec is stored too.
        training: Record of the training, of values that JSON can hold.

    Raises:
        CheckpointError: If the file cannot be written.
    """
    path = Path(path)
    record = {"schema": SCHEMA, "spec": model.spec.to_dict(), "training": training}
    tensors = {name: value.contiguous() for name, value in model.state_dict().items()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as file:
            file.write(save(tensors, metadata={METADATA_KEY: json.dumps(record)}))
    except OSError as error:
        raise CheckpointError(f"{path}: cannot be written ({error.strerror or error})") from error


def load_checkpoint(path: str | Path) -> tuple[TreeRCNN, dict[str, Any]]:
    """Read a checkpoint of this project.

    Args:
        path: A safetensors file that :func:`save_checkpoint` wrote.

    Returns:
        The model in eval mode, and the metadata: a dict with ``schema``, ``spec`` and
        ``training``.

    Raises:
        CheckpointError: If the file is missing, unreadable or of another kind, if its tensors do
            not match its spec, or if a weight is not finite.
    """
    path = Path(path)
    record, tensors = _read(path)
    try:
        spec = ModelSpec.from_dict(record["spec"])
        expected = tensors_of(spec)
    except SpecError as error:
        raise CheckpointError(f"{path}: {error}") from error
    check_tensors(path, expected, tensors)
    check_finite(path, tensors)
    model = TreeRCNN(spec)
    model.load_state_dict(tensors)
    return model.eval(), record


def tensors_of(spec: ModelSpec) -> dict[str, torch.Tensor]:
    """Return the tensors of a model by name, without memory for their values.

    Raises:
        SpecError: If there is no such model.
    """
    with torch.device("meta"):
        return TreeRCNN(spec).state_dict()


def _read(path: Path) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    if not path.is_file():
        raise CheckpointError(f"{path}: no such file, expected a .safetensors checkpoint")
    if not is_utf8(path):
        raise CheckpointError(f"{path}: its path is not UTF-8, expected another name")
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(METADATA_KEY)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        record = json.loads(text) if text else None
    except (SafetensorError, OSError, ValueError, RecursionError) as error:
        raise CheckpointError(f"{path}: not a readable safetensors file ({error})") from error
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise CheckpointError(f"{path}: not a perceptree checkpoint, expected schema {SCHEMA}")
    if not isinstance(record.get("spec"), dict):
        raise CheckpointError(f"{path}: the checkpoint has no model spec")
    if not isinstance(record.get("training"), dict):
        raise CheckpointError(f"{path}: the checkpoint has no training record")
    return record, tensors


def check_tensors(
    path: Path | str, expected: Mapping[str, torch.Tensor], found: Mapping[str, torch.Tensor]
) -> None:
    """Check names and shapes of tensors.

    Args:
        path: File or source that an error names.
        expected: The tensors that there should be.
        found: The tensors that there are.

    Raises:
        CheckpointError: If tensors are missing, unexpected or of another shape; the message lists
            the first three.
    """
    faults = [f"{name} is missing" for name in expected if name not in found]
    faults += [f"{name} is unexpected" for name in found if name not in expected]
    faults += [
        f"{name} has shape {tuple(found[name].shape)}, expected {tuple(value.shape)}"
        for name, value in expected.items()
        if name in found and found[name].shape != value.shape
    ]
    if faults:
        more = f" and {len(faults) - 3} more" if len(faults) > 3 else ""
        raise CheckpointError(f"{path}: {'; '.join(faults[:3])}{more}")


def check_finite(path: Path | str, tensors: Mapping[str, torch.Tensor]) -> None:
    """Check that all numbers are finite.

    Args:
        path: File or source that an error names.
        tensors: Tensors by name.

    Raises:
        CheckpointError: If a number is infinite or NaN; the message names the first such tensor.
    """
    for name, value in tensors.items():
        if value.is_floating_point() and value.numel():
            low, high = value.aminmax()
            if not (torch.isfinite(low) and torch.isfinite(high)):
                raise CheckpointError(f"{path}: {name} holds NaN or infinity, expected numbers")
