"""Files that are made once in a run of the tests, by the first of its processes that needs them."""

from __future__ import annotations

import pickle
import shutil
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class Once:
    """Makes files in folders that all processes of a run share. Nobody may change them.

    Args:
        root: folder of the run.
    """

    def __init__(self, root: Path) -> None:
        self._root = root

    def folder(self, name: str, make: Callable[[Path], object]) -> Path:
        """The folder of this name, which `make` fills if no process has done so yet."""
        folder, done = self._root / name, self._root / f"{name}.done"
        with self._locked(name):
            if not done.exists():
                shutil.rmtree(folder, ignore_errors=True)  # of a process that failed
                folder.mkdir(parents=True)
                make(folder)
                done.touch()
        return folder

    def value(self, name: str, make: Callable[[Path], Any]) -> Any:
        """What `make` returned when it filled the folder of this name."""

        def store(folder: Path) -> None:
            (folder / "value.pickle").write_bytes(pickle.dumps(make(folder)))

        return pickle.loads((self.folder(name, store) / "value.pickle").read_bytes())

    @contextmanager
    def _locked(self, name: str) -> Iterator[None]:
        self._root.mkdir(parents=True, exist_ok=True)
        with (self._root / f"{name}.lock").open("w") as lock:
            if sys.platform != "win32":
                import fcntl

                fcntl.flock(lock, fcntl.LOCK_EX)
            yield
