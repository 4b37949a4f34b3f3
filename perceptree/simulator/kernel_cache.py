"""Cache folder of the compiled numba kernels: one folder per version of the sources.

Numba recompiles a kernel when its own file changes, but not when functions it calls from other
files change. A folder named by the hash of all sources prevents loading an outdated kernel.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_FOLDER = Path(__file__).parent / "rendering"


def sources_sha256(folder: Path = _FOLDER) -> str:
    """Hash names and contents of a folder's Python files."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


@contextmanager
def versioned_cache() -> Iterator[None]:
    """Cache kernels that are defined in the block by the version of their sources.

    A cache folder that the user has configured (NUMBA_CACHE_DIR) is used unchanged.
    """
    from numba.core import config as numba_config

    config: Any = numba_config
    chosen = config.CACHE_DIR
    if not chosen:
        config.CACHE_DIR = str(_own_folder())
    try:
        yield
    finally:
        config.CACHE_DIR = chosen


def is_compiled() -> bool:
    """Whether an earlier run has left compiled kernels of this version; does not load numba."""
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    return any((Path(chosen) if chosen else _own_folder()).rglob("*.nbi"))


def _own_folder() -> Path:
    return _FOLDER / "__pycache__" / sources_sha256()[:16]
