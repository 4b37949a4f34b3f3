"""Test which of onnxruntime's providers can run a network on this machine."""

from __future__ import annotations

import re
import subprocess
from typing import Final

import numpy as np

from basetree.errors import MissingPackage
from basetree.program.python import run_python
from edgetree.doctor.findings import ProviderResult
from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.runtime.providers import CPU, PROVIDERS, import_onnxruntime, installed_providers

_LIMIT_S: Final = 120
_MAX_CHARACTERS: Final = 160
_TRY: Final = (
    "import sys; from edgetree.doctor.providers import run_small_network as run; run(sys.argv[1])"
)
_SIZE: Final = 8
_LARGEST_ERROR: Final = 0.01  # some providers compute in half precision


def examine_providers() -> tuple[ProviderResult, ...]:
    """Test each provider in its own process, as a broken driver may crash the process.

    Returns:
        One result per installed provider; empty if onnxruntime is not installed.
    """
    try:
        names = installed_providers()
    except MissingPackage:
        return ()
    return tuple(_examine(name) for name in names)


def _examine(name: str) -> ProviderResult:
    try:
        done = run_python("-c", _TRY, name, limit_s=_LIMIT_S)
    except subprocess.TimeoutExpired:
        return ProviderResult(name, False, f"not finished after {_LIMIT_S} s")
    if done.returncode == 0:
        return ProviderResult(name, True)
    return ProviderResult(name, False, _reason(done.stderr) or f"ended with {done.returncode}")


def _reason(errors: str) -> str:
    """The reason of a failure: onnxruntime's first error, else the message of the exception."""
    lines = [re.sub(r"\x1b\[[\d;]*m", "", line) for line in errors.splitlines() if line.strip()]
    logged = [line for line in lines if "[E:onnxruntime" in line]
    text = (logged or lines[-1:] or [""])[0]
    text = re.sub(r"^.*?\] ", "", text) if logged else text.partition(": ")[2] or text
    return text if len(text) <= _MAX_CHARACTERS else f"{text[:_MAX_CHARACTERS]}..."


def small_network() -> bytes:
    """An ONNX model with a convolution and a sigmoid, from `x` to `y`, (1, 4, 8, 8) float32."""
    kind = TensorType("float32", (1, 4, _SIZE, _SIZE))
    return onnx_bytes(
        [Node("Conv", ("x", "weight"), ("z",)), Node("Sigmoid", ("z",), ("y",))],
        inputs={"x": kind},
        outputs={"y": kind},
        constants={"weight": np.eye(4, dtype=np.float32)[:, :, None, None]},
    )


def run_small_network(name: str) -> None:
    """Run `small_network` on one provider only.

    Args:
        name: a name in `edgetree.runtime.PROVIDERS`.

    Raises:
        RuntimeError: Another provider was used, or the output is wrong.
    """
    onnxruntime = import_onnxruntime()
    provider = PROVIDERS[name].ort_name
    options = onnxruntime.SessionOptions()
    options.log_severity_level = 3
    if name != CPU:
        options.add_session_config_entry("session.disable_cpu_ep_fallback", "1")
    session = onnxruntime.InferenceSession(
        small_network(), sess_options=options, providers=[provider], enable_fallback=0
    )
    if session.get_providers()[0] != provider:
        raise RuntimeError(f"onnxruntime used {session.get_providers()[0]} instead")
    x = np.linspace(-2, 2, 4 * _SIZE * _SIZE, dtype=np.float32).reshape(1, 4, _SIZE, _SIZE)
    (y,) = session.run(None, {"x": x})
    error = float(np.abs(y - 1 / (1 + np.exp(-x))).max())
    if not error < _LARGEST_ERROR:
        raise RuntimeError(f"the output is wrong by {error:.2g}")
