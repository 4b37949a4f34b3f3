"""Cache folder of the compiled numba kernels: one folder per version of the sources.

Numba recompiles a kernel when its own file changes, but not when functions it calls from other
files change. A folder named by the hash of all sources prevents loading an outdated kernel.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from numba.core import config as _numba_config

_FOLDER = Path(__file__).parent
_config: Any = _numba_config


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
    chosen = _config.CACHE_DIR
    if not chosen:
        _config.CACHE_DIR = str(_FOLDER / "__pycache__" / sources_sha256()[:16])
    try:
        yield
    finally:
        _config.CACHE_DIR = chosen
