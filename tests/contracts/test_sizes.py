"""Library files and functions stay small enough to be read in one sitting."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted(p for top in ("calib", "edgetree", "perceptree") for p in (ROOT / top).rglob("*.py"))
MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 45


def function_sizes(source: str) -> Iterator[tuple[str, int]]:
    """(name, lines without the docstring) of every function, those inside others included."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            if ast.get_docstring(node, clean=False) is not None:
                docstring = node.body[0]
                lines -= (docstring.end_lineno or docstring.lineno) - docstring.lineno + 1
            yield node.name, lines


def test_files_are_at_most_400_lines() -> None:
    sizes = {str(p.relative_to(ROOT)): len(p.read_text("utf-8").splitlines()) for p in FILES}
    assert {name: lines for name, lines in sizes.items() if lines > MAX_FILE_LINES} == {}


def test_functions_are_at_most_45_lines() -> None:
    sizes = {
        f"{path.relative_to(ROOT)}:{name}": lines
        for path in FILES
        for name, lines in function_sizes(path.read_text("utf-8"))
    }
    assert {name: lines for name, lines in sizes.items() if lines > MAX_FUNCTION_LINES} == {}


def test_the_function_check_counts_lines_without_the_docstring() -> None:
    source = 'def short():\n    """One.\n\n    More.\n    """\n    return 1\n'
    assert list(function_sizes(source)) == [("short", 2)]
