"""Trust files of the test's own, in this process and in all that it starts.

The machine that runs the tests may require signatures, and a test that runs as root could write its
file, which would refuse the models of all other tests.
"""

import itertools
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from own_machine import sitecustomize

_BASE = tempfile.TemporaryDirectory(prefix="edgetree-tests-", ignore_cleanup_errors=True)
_HOOKS = str(Path(__file__).parent)
_popen = subprocess.Popen.__init__


def variables(name: str) -> dict[str, str]:
    """What a machine's own folders are called; they are not made."""
    folder = Path(_BASE.name, name)
    return {
        sitecustomize.FOLDER: str(folder / "etc"),
        "XDG_CONFIG_HOME": str(folder / "config"),
        "XDG_STATE_HOME": str(folder / "state"),
    }


def machines() -> Iterator[dict[str, str]]:
    """The variables of one machine after the other."""
    return (variables(str(number)) for number in itertools.count())


def use() -> None:
    """Set the folder in this process, if the module is imported already."""
    if (module := sys.modules.get(sitecustomize.MODULE)) is not None:
        sitecustomize.move(module)


def hooked(environment: dict[str, str]) -> dict[str, str]:
    """An environment in which Python finds the hook, after what it finds there already."""
    paths = environment.get("PYTHONPATH", "").split(os.pathsep)
    return {
        sitecustomize.FOLDER: os.environ[sitecustomize.FOLDER],
        **environment,
        "PYTHONPATH": os.pathsep.join(filter(None, [*(p for p in paths if p != _HOOKS), _HOOKS])),
    }


def _start(self: Any, *args: Any, env: Any = None, **others: Any) -> None:
    _popen(self, *args, env=hooked(dict(os.environ if env is None else env)), **others)


os.environ |= variables("session")
os.environ |= hooked(dict(os.environ))
subprocess.Popen.__init__ = _start  # type: ignore[method-assign]
