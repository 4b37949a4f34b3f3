"""The examples in docstrings of public names give what they say."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NEEDS_TORCH = ("perceptree",)


def modules_with_examples() -> list[str]:
    """Modules of the packages whose source holds a prompt."""
    return [
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for package in ("basetree", "calib", "edgetree", "perceptree")
        for path in sorted((ROOT / package).rglob("*.py"))
        if ">>> " in path.read_text("utf-8")
    ]


@pytest.mark.parametrize("name", modules_with_examples())
def test_examples_give_what_they_say(name: str) -> None:
    if name.startswith(NEEDS_TORCH):
        pytest.importorskip("torch")
    module = importlib.import_module(name)
    failed, tried = doctest.testmod(module, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert tried > 0
    assert failed == 0


def test_all_packages_have_examples() -> None:
    tops = {name.partition(".")[0] for name in modules_with_examples()}
    assert tops == {"basetree", "calib", "edgetree", "perceptree"}
    assert len(modules_with_examples()) > 15


def test_a_wrong_example_is_seen() -> None:
    def wrong() -> None:
        """Add.

        >>> 1 + 1
        3
        """

    found = doctest.DocTestFinder().find(wrong, "wrong", globs={})
    runner = doctest.DocTestRunner(verbose=False)
    results = [runner.run(test, out=lambda text: None) for test in found]
    assert sum(result.failed for result in results) == 1
