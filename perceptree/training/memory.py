"""Settings of the memory allocator that speed up training on CPUs."""

from __future__ import annotations

import ctypes
import sys

# Parameters of mallopt(3); the numbers are part of glibc's interface.
_M_TRIM_THRESHOLD, _M_TOP_PAD, _M_MMAP_MAX = -1, -2, -4
_KEEP_ALL = 2**31 - 1
_GROW_BYTES = 2**28


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
