"""What each package exports is what its `__all__` says."""

import ast
import importlib
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOPS = ("basetree", "calib", "edgetree", "fleet", "perceptree")
PACKAGES = sorted(
    ".".join(path.parent.relative_to(ROOT).parts)
    for top in TOPS
    for path in (ROOT / top).rglob("__init__.py")
)


def top_level(nodes: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Statements that run, or would be read by a type checker, as the module loads."""
    for node in nodes:
        yield node
        if isinstance(node, ast.If):
            yield from top_level(node.body + node.orelse)


def offered_names(source: str) -> set[str]:
    """Public names that a package's `__init__.py` defines, or takes from this project's modules.

    What it takes from elsewhere (`typing`, numpy) is a tool, not an offer.
    """
    names = set()
    for node in top_level(ast.parse(source).body):
        if isinstance(node, ast.ImportFrom):
            own = node.level > 0 or (node.module or "").partition(".")[0] in TOPS
            own = own and node.module != "basetree.deprecation"
            names |= {alias.asname or alias.name for alias in node.names} if own else set()
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
    return {name for name in names if not name.startswith("_")}


@pytest.mark.parametrize("package", PACKAGES)
def test_exported_names_equal_all(package: str) -> None:
    module = importlib.import_module(package)
    source = (ROOT.joinpath(*package.split(".")) / "__init__.py").read_text("utf-8")
    announced = list(module.__all__)
    assert set(announced) == offered_names(source)
    assert len(announced) == len(set(announced))
    assert [name for name in announced if not hasattr(module, name)] == []


def test_all_packages_are_looked_at() -> None:
    assert set(TOPS) <= set(PACKAGES)


def test_the_check_sees_what_a_package_offers() -> None:
    source = (
        "from typing import TYPE_CHECKING, Any\n"
        "from calib.camera import PinholeCamera\n"
        "if TYPE_CHECKING:\n    from .lazy import Later as Sooner\n"
        "LIMIT: int = 3\n_hidden = OPEN = 1\n"
        "def work() -> Any:\n    inner = 1\n    return inner\n"
        "class _Private: ...\n"
    )
    assert offered_names(source) == {"PinholeCamera", "Sooner", "LIMIT", "OPEN", "work"}
