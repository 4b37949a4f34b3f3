"""Choose the faster of float32 and bfloat16 on this machine."""

from __future__ import annotations

import time
from functools import cache

import torch
from torch.nn import functional

_REPEATS = 20
_CLEARLY_FASTER = 1.2


@cache
def fastest_precision(device: torch.device) -> str:
    """Return ``bf16`` or ``fp32``, whichever is faster on a device.

    CPUs without bfloat16 instructions emulate it, several times slower than float32. On a CPU a
    convolution with its gradient is therefore timed in both precisions, alternately; the shortest
    of many runs counts. On a GPU hardware support decides.

    Args:
        device: The device of the training.
    """
    if device.type == "cuda":
        return "bf16" if torch.cuda.is_bf16_supported(including_emulation=False) else "fp32"
    times_s = {"fp32": float("inf"), "bf16": float("inf")}
    for _ in range(_REPEATS):
        for precision in times_s:
            taken_s = _convolution_s(precision == "bf16")
            times_s[precision] = min(times_s[precision], taken_s)
    return "bf16" if times_s["fp32"] > _CLEARLY_FASTER * times_s["bf16"] else "fp32"


def _convolution_s(bf16: bool) -> float:
    generator = torch.Generator().manual_seed(0)
    image = torch.randn(1, 64, 48, 80, generator=generator).to(memory_format=torch.channels_last)
    weight = torch.randn(64, 64, 3, 3, generator=generator)
    image.requires_grad_()
    weight.requires_grad_()
    start_s = time.perf_counter()
    with torch.autocast("cpu", torch.bfloat16, enabled=bf16):
        made = functional.conv2d(image, weight, padding=1)
    made.float().sum().backward()  # type: ignore[no-untyped-call]
    return time.perf_counter() - start_s
