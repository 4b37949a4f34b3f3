"""What makes training fast on this machine: the allocator's settings and the faster precision."""

from __future__ import annotations

import ctypes
import sys
import time
from functools import cache

import torch
from torch.nn import functional

# Parameters of mallopt(3); the numbers are part of glibc's interface.
_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_MAX = -1, -2, -4
_KEEP_ALL = 2**31 - 1
_GROW_BYTES = 2**28
_REPEATS = 20
_CLEARLY_FASTER = 1.2


def keep_freed_memory() -> None:
    """Make glibc keep freed memory for the next step instead of returning it to the system.

    By default glibc returns large blocks such as feature maps, and the system clears the pages
    again for the next step. On two cores that takes about 60,000 page faults and a tenth of the
    time of a step. Has no effect with another C library.
    """
    if not sys.platform.startswith("linux"):
        return
    try:
        mallopt = ctypes.CDLL("libc.so.6").mallopt
    except (OSError, AttributeError):
        return
    mallopt(_M_MMAP_MAX, 0)
    mallopt(_M_TRIM_THRESHOLD, _KEEP_ALL)
    mallopt(_M_TOP_PAD, _GROW_BYTES)


@cache
def fastest_precision(device: torch.device) -> str:
    """Return `bf16` or `fp32`, whichever is faster on a device.

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
