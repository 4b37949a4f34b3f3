"""Where numba keeps the compiled kernels: a folder of its own for every version of the sources.

Numba notices a change of the file that a kernel stands in, not of the functions it calls from
other files. A folder named by the hash of all sources keeps a stale kernel from being loaded.
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
    """Hash of a folder's Python files and their names."""
    digest = hashlib.sha256()
    for path in sorted(folder.glob("*.py")):
        digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


@contextmanager
def versioned_cache() -> Iterator[None]:
    """Kernels defined within are cached by the version of the sources; a set folder is kept."""
    chosen = _config.CACHE_DIR
    if not chosen:
        _config.CACHE_DIR = str(_FOLDER / "__pycache__" / sources_sha256()[:16])
    try:
        yield
    finally:
        _config.CACHE_DIR = chosen
