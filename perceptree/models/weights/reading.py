"""Read weights from an untrusted checkpoint file without executing anything from it."""

from __future__ import annotations

import math
import pickle
import re
import warnings
from collections.abc import Mapping
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import IO, Any, cast

import torch
from torch import Tensor

from basetree.files.regular import open_regular
from perceptree.errors import CheckpointError
from perceptree.models.checkpoint import check_is_file
from perceptree.models.weights.archives import check_archive
from perceptree.models.weights.pickles import SAFE_GLOBALS, ArrayRecord, read_pickle

Tensors = dict[str, Tensor]

_ZIP = b"PK\x03\x04"
# The magic number of torch's older file format, as a pickle encodes it.
_OLD_TORCH = b"\x8a\nl\xfc\x9cF\xf9 j\xa8P\x19."
# Message of torch's unpickler, and of ours, for a name that is not allowed.
_FORBIDDEN = re.compile(r"GLOBAL (\S+)")
_TORCH_SAYS = "WeightsUnpickler error: "
_HOLDERS = ("model", "state_dict", "blobs")
_PARALLEL = "module."
_LONGEST_NAME = 200
_MOST_SHARED = 2  # times that the data of a file may be used, as by layers that share weights


def read_weights(path: Path) -> Tensors:
    """Read the tensors of a `.pth` or `.pkl` file.

    The content decides the format: one of torch's two, or a plain pickle of numpy arrays.

    Args:
        path: File to read.

    Returns:
        Tensors by name. Floating-point tensors are converted to float32.

    Raises:
        CheckpointError: If the file cannot be read, would execute code, or holds anything but
            tensors of finite numbers.
    """
    weights = _weights_of(path, _content(path))
    tensors = {_checked_name(path, name): value for name, value in weights.items()}
    if all(name.startswith(_PARALLEL) for name in tensors):
        tensors = {name.removeprefix(_PARALLEL): value for name, value in tensors.items()}
    _check_sum(path, tensors)
    return {name: _as_tensor(path, name, value) for name, value in tensors.items()}


def _check_sum(path: Path, values: Mapping[str, Any]) -> None:
    """Check that all tensors together are not much larger than the file.

    Many names may share the data of one tensor, of which each would become a copy.
    """
    size = path.stat().st_size
    claimed = 0
    for value in values.values():
        if isinstance(value, Tensor):
            claimed += value.numel() * value.element_size()
        elif isinstance(value, ArrayRecord):
            claimed += value.stored_bytes
    if claimed > _MOST_SHARED * size:
        raise CheckpointError(
            f"{path}: {len(values)} tensors of {claimed} bytes in a file of {size} bytes, expected"
            " each with data of its own"
        )


def _content(path: Path) -> Any:
    check_is_file(path, "a .pth or .pkl checkpoint")
    try:
        with open_regular(path) as file:
            head = file.read(32)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CheckpointError(f"{path}: cannot be read ({reason})") from error
    if not head:
        raise CheckpointError(f"{path}: is empty, expected a .pth or .pkl checkpoint")
    if head[8:9] == b"{":
        raise CheckpointError(f"{path}: is a safetensors file, expected a .pth or .pkl checkpoint")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return _load(path, head)
    except Exception as error:
        raise CheckpointError(f"{path}: {_reason(error)}") from error


def _load(path: Path, head: bytes) -> Any:
    with open_regular(path) as file:
        if not head.startswith(_ZIP) and _OLD_TORCH not in head:
            return read_pickle(file)
        check_archive(path)
        # A file takes memory for as many bytes as a pickle asks for, a map for those it has.
        with (
            torch.serialization.safe_globals(list(SAFE_GLOBALS)),
            mmap(file.fileno(), 0, access=ACCESS_READ) as content,
        ):
            source = path if head.startswith(_ZIP) else cast("IO[bytes]", content)
            return torch.load(source, map_location="cpu", weights_only=True)


def _reason(error: Exception) -> str:
    """Why a file was not read, in one line: it is broken, or it would execute code."""
    text = str(error)
    found = _FORBIDDEN.search(text)
    if isinstance(error, pickle.UnpicklingError) and found:
        return f"refused, it would call {_shown(found[1])}, which weights do not need"
    why = text.rpartition(_TORCH_SAYS)[2].partition("\n")[0]
    return f"not a readable checkpoint, or truncated ({_shown(why) or type(error).__name__})"


def _weights_of(path: Path, content: Any) -> Mapping[Any, Any]:
    weights = content
    if isinstance(content, dict):
        held = next((dict.get(content, key) for key in _HOLDERS if key in content), None)
        weights = content if held is None else held
    if not isinstance(weights, dict):
        raise CheckpointError(
            f"{path}: holds a {type(weights).__name__}, expected tensors by name, under 'model'"
        )
    plain = {key: dict.__getitem__(weights, key) for key in dict.keys(weights)}
    if not any(isinstance(value, Tensor | ArrayRecord) for value in plain.values()):
        names = ", ".join(_shown(key) for key in list(plain)[:3]) or "nothing"
        raise CheckpointError(f"{path}: holds {names}, expected tensors by name, under 'model'")
    return plain


def _checked_name(path: Path, name: object) -> str:
    if not isinstance(name, str) or not name.isprintable() or len(name) > _LONGEST_NAME:
        raise CheckpointError(
            f"{path}: a tensor is named {_shown(name)!r}, expected printable text of at most "
            f"{_LONGEST_NAME} characters"
        )
    return name


def _as_tensor(path: Path, name: str, value: Any) -> Tensor:
    if isinstance(value, ArrayRecord):
        try:
            value = torch.from_numpy(value.build())
        except (ValueError, TypeError) as error:
            raise CheckpointError(f"{path}: {name} holds {_shown(error)}") from error
    if not isinstance(value, Tensor):
        kind = type(value).__name__
        raise CheckpointError(f"{path}: {name} is a {kind}, expected a tensor or an array")
    plain = value.device.type == "cpu" and value.layout is torch.strided and not value.is_quantized
    if not plain or value.is_complex():
        raise CheckpointError(f"{path}: {name} is not a plain tensor of real numbers")
    tensor: Tensor = value.detach()
    if tensor.numel() * tensor.element_size() > tensor.untyped_storage().nbytes():
        raise CheckpointError(
            f"{path}: {name} has shape {tuple(tensor.shape)}, more than its stored data; expected"
            " a tensor with all its values"
        )
    if tensor.is_floating_point():
        tensor = tensor.to(torch.float32)
        if not all(map(math.isfinite, _extremes(tensor))):
            raise CheckpointError(f"{path}: {name} holds numbers that are not finite")
    return tensor.contiguous()


def _extremes(tensor: Tensor) -> tuple[float, ...]:
    """Minimum and maximum, both NaN if the tensor has a NaN."""
    if not tensor.numel():
        return ()
    low, high = tensor.aminmax()
    return float(low), float(high)


def _shown(value: object) -> str:
    """Untrusted text on one line: printable characters only, at a limited length."""
    text = " ".join(str(value).split()) if isinstance(value, str | Exception) else repr(type(value))
    return "".join(c for c in text if c.isprintable())[:_LONGEST_NAME]
