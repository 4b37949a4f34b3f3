"""How fast this machine multiplies: the peak that the speed of networks is compared with.

Products of large square matrices, the work that processors do best, in the number formats that
networks use: float32 and 8 bits by onnxruntime, which runs the networks; bfloat16 by PyTorch where
it is installed, as onnxruntime has no such products on x86 processors.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any, Final

import numpy as np

from edgetree.model_file.onnx_bytes import Node, TensorType, onnx_bytes
from edgetree.runtime.providers import import_onnxruntime

_SIDE: Final = 1024
_SHAPE: Final = (_SIDE, _SIDE)
_FEWEST_RUNS: Final = 5
_GIGA: Final = 1e9


def machine_peak(threads: int, duration_s: float) -> dict[str, float | None]:
    """Measure the multiply-adds per second of large matrix products, in units of 10^9.

    Args:
        threads: Threads of one product.
        duration_s: Time to measure each number format for.

    Returns:
        `float32`, `int8` and `bfloat16`; None where a format cannot be measured.
    """
    return {
        "float32": _rate(_onnx_product("MatMul", np.float32, np.float32, threads), duration_s),
        "int8": _rate(_onnx_product("MatMulInteger", np.uint8, np.int8, threads), duration_s),
        "bfloat16": _bfloat16_rate(threads, duration_s),
    }


def _rate(product: Callable[[], Any], duration_s: float) -> float:
    """Multiply-adds per second of the fastest run, in units of 10^9."""
    product()
    times_s: list[float] = []
    while sum(times_s) < duration_s or len(times_s) < _FEWEST_RUNS:
        start = time.perf_counter()
        product()
        times_s.append(time.perf_counter() - start)
    return round(_SIDE**3 / min(times_s) / _GIGA, 1)


def _onnx_product(operator: str, left: type, right: type, threads: int) -> Callable[[], Any]:
    result = "float32" if left is np.float32 else "int32"
    rng = np.random.default_rng(0)
    factors: list[Any] = [rng.integers(0, 100, _SHAPE).astype(kind) for kind in (left, right)]
    content = onnx_bytes(
        [Node(operator, ("x", "weights"), ("y",))],
        inputs={"x": TensorType(np.dtype(left).name, _SHAPE)},
        outputs={"y": TensorType(result, _SHAPE)},
        constants={"weights": factors[1]},
    )
    onnxruntime = import_onnxruntime()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
    return lambda: session.run(None, {"x": factors[0]})


def _bfloat16_rate(threads: int, duration_s: float) -> float | None:
    try:
        import torch
    except ImportError:
        return None
    torch.set_num_threads(threads)
    factor = torch.ones(_SHAPE, dtype=torch.bfloat16)
    return _rate(lambda: factor @ factor, duration_s)
