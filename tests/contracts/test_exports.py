"""What each package exports is what its `__all__` says."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for top in ("calib", "edgetree", "perceptree")
    for path in (ROOT / top).rglob("__init__.py")
)


def public_names(module: ModuleType) -> set[str]:
    """Names a package binds for its users: no submodules, no private names."""
    return {
        name
        for name, value in vars(module).items()
        if not name.startswith("_") and not isinstance(value, ModuleType) and name != "annotations"
    }


def disagreements(module: ModuleType) -> set[str]:
    """Names that are bound but not announced, announced twice, or announced but not to be had."""
    announced: list[str] = list(getattr(module, "__all__", []))
    missing = {name for name in announced if not hasattr(module, name)}
    twice = {name for name in announced if announced.count(name) > 1}
    return (public_names(module) - set(announced)) | missing | twice


@pytest.mark.parametrize("package", PACKAGES)
def test_exported_names_equal_all(package: str) -> None:
    module = importlib.import_module(package)
    assert hasattr(module, "__all__"), f"{package} has no __all__"
    assert disagreements(module) == set()


def test_all_three_packages_are_looked_at() -> None:
    assert {"calib", "edgetree", "perceptree"} <= set(PACKAGES)


def test_the_check_can_fail() -> None:
    module = ModuleType("example")
    vars(module).update(kept=1, forgotten=2, _private=3, __all__=["kept", "gone", "twice", "twice"])
    vars(module)["twice"] = 4
    assert disagreements(module) == {"forgotten", "gone", "twice"}
