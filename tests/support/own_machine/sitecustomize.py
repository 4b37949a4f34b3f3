"""Python runs this in every process that a test starts: the machine's trust file is the test's own.

The package has no variable for that folder on purpose, as accounts could get round it.
"""

import os
import sys
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType
from typing import Any

FOLDER = "EDGETREE_TESTS_MACHINE"
MODULE = "edgetree.signing.trust"


class _Finder(PathFinder):
    """Finds the module of the trust files, and changes the folder in it once it is imported."""

    @classmethod
    def find_spec(cls, name: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        spec = super().find_spec(name, path, target) if name == MODULE else None
        if spec is None or spec.loader is None:
            return None
        execute = spec.loader.exec_module

        def changed(module: ModuleType) -> None:
            execute(module)
            move(module)

        spec.loader.exec_module = changed  # type: ignore[method-assign]
        return spec


def move(module: Any) -> None:
    """Set the folder of the machine's trust file."""
    module._MACHINE_FOLDER = module.Path(os.environ[FOLDER])


sys.meta_path.insert(0, _Finder)
