"""Checkpoints: weights, model spec and training record in one safetensors file."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from basetree.files.names import is_utf8
from basetree.files.writing import replacing
from perceptree.errors import CheckpointError
from perceptree.models.detector import TreeRCNN
from perceptree.models.spec import ModelSpec, SpecError

SCHEMA = "perceptree.checkpoint/1"
METADATA_KEY = "perceptree"
# Far above the weights of any trained network, and far below those whose highest exponent bit was
# flipped: it multiplies numbers below 2 by 2**128.
LARGEST_WEIGHT = 1e6


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
        path: A safetensors file that `save_checkpoint` wrote.

    Returns:
        The model in eval mode, and the metadata: a dict with `schema`, `spec` and
        `training`.

    Raises:
        CheckpointError: If the file is missing, unreadable or of another kind, if its tensors do
            not match its spec, or if a weight cannot be one.
    """
    path = Path(path)
    record, tensors = _read(path)
    try:
        spec = ModelSpec.from_dict(record["spec"])
        expected = tensors_of(spec)
    except SpecError as error:
        raise CheckpointError(f"{path}: {error}") from error
    check_tensors(path, expected, tensors)
    check_values(path, tensors)
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
    check_is_file(path, "a .safetensors checkpoint")
    if path.suffix == ".onnx":
        raise CheckpointError(
            f"{path}: is an exported model, expected its .safetensors checkpoint; `edgetree eval`"
            " and `edgetree run` take exported models"
        )
    if not is_utf8(path):
        raise CheckpointError(f"{path}: its path is not UTF-8, expected another name")
    try:
        with safe_open(path, framework="pt") as file:
            text = (file.metadata() or {}).get(METADATA_KEY)
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        record = json.loads(text) if text else None
    except (SafetensorError, OSError, ValueError, RecursionError) as error:
        raise CheckpointError(
            f"{path}: not a readable safetensors file ({error}), expected a perceptree checkpoint"
        ) from error
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise CheckpointError(f"{path}: not a perceptree checkpoint, expected schema {SCHEMA}")
    if not isinstance(record.get("spec"), dict):
        raise CheckpointError(f"{path}: the checkpoint has no model spec")
    if not isinstance(record.get("training"), dict):
        raise CheckpointError(f"{path}: the checkpoint has no training record")
    return record, tensors


def check_is_file(path: Path, expected: str) -> None:
    """Check that a path is a regular file; opening a pipe would wait for ever.

    Args:
        path: Path of the file.
        expected: What the file should be, for messages.

    Raises:
        CheckpointError: If there is no such file, or it is a folder, a pipe or a device.
    """
    if path.is_dir():
        raise CheckpointError(f"{path}: is a folder, expected {expected}")
    if path.exists() and not path.is_file():
        raise CheckpointError(f"{path}: is a pipe, socket or device, expected {expected}")
    if not path.exists():
        raise CheckpointError(f"{path}: no such file, expected {expected}")


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


def check_values(path: Path | str, tensors: Mapping[str, torch.Tensor]) -> None:
    """Check that weights have values that a trained network can have.

    Most damage to a file stays unnoticed: it changes a number a little, or makes it smaller.

    Args:
        path: File or source that an error names.
        tensors: Tensors by name, here or in Detectron2.

    Raises:
        CheckpointError: If a number is infinite, NaN or larger than `LARGEST_WEIGHT` (its square
            for a variance), or if a variance is negative. The message names the first such tensor.
    """
    for name, value in tensors.items():
        if not value.is_floating_point() or not value.numel():
            continue
        low, high = (float(end) for end in value.aminmax())
        if not (math.isfinite(low) and math.isfinite(high)):
            raise CheckpointError(f"{path}: {name} holds NaN or infinity, expected numbers")
        least, most = -LARGEST_WEIGHT, LARGEST_WEIGHT
        if name.endswith("running_var"):
            least, most = 0.0, LARGEST_WEIGHT**2
        if low < least or high > most:
            wrong = low if low < least else high
            raise CheckpointError(
                f"{path}: {name} holds {wrong:g}, expected {least:g} to {most:g}; the file may be"
                " damaged"
            )
