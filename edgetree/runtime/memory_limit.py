"""Limit the memory that a block of code may take."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

try:
    import resource
except ImportError:  # Windows
    resource = None  # type: ignore[assignment]

_STATM: Final = Path("/proc/self/statm")
_turn = threading.Lock()


@contextmanager
def memory_limit(more_bytes: int) -> Iterator[None]:
    """Let the process take at most `more_bytes` more address space inside the block.

    An allocation beyond it fails, as if the machine had no more memory. The limit is that of the
    whole process, so one thread at a time is inside such a block. It has no effect on systems
    without /proc.
    """
    if resource is None or not _STATM.exists():
        yield
        return
    with _turn:
        in_use = int(_STATM.read_text("ascii").split()[0]) * resource.getpagesize()
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        allowed = in_use + more_bytes
        for other in (soft, hard):
            allowed = allowed if other == resource.RLIM_INFINITY else min(allowed, other)
        resource.setrlimit(resource.RLIMIT_AS, (allowed, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
