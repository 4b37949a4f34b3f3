"""What programs print goes through `basetree.program.console`, which cleans each line."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [
    path
    for folder in ("basetree", "calib", "edgetree", "fleet", "perceptree")
    for path in sorted((ROOT / folder).rglob("*.py"))
]
PRINTERS = {
    "basetree/program/console.py",
    "basetree/program/command_line.py",  # the program's version and help
    "edgetree/bench/worker.py",  # to the process that started it, which cleans it
    "edgetree/__main__.py",  # Ctrl-C before the console can be imported
    "perceptree/__main__.py",
}
STREAMS = {"stdout", "stderr", "__stdout__", "__stderr__"}


def prints(code: str) -> bool:
    """Whether code calls print or echo, or writes to a standard stream or gives it to a writer."""
    for node in ast.walk(ast.parse(code)):
        if not isinstance(node, ast.Call):
            continue
        called = node.func
        name = called.attr if isinstance(called, ast.Attribute) else getattr(called, "id", "")
        if name in {"print", "echo", "secho", "pprint", "print_exc", "StreamHandler"}:
            return True
        given = [keyword.value for keyword in node.keywords if keyword.arg == "file"]
        owner = called.value if isinstance(called, ast.Attribute) and name == "write" else None
        if any(
            isinstance(each, ast.Attribute) and each.attr in STREAMS for each in [owner, *given]
        ):
            return True
    return False


def test_lines_are_printed_in_one_place() -> None:
    found = {path for path in SOURCES if prints(path.read_text("utf-8"))}
    assert {str(path.relative_to(ROOT)) for path in found} == PRINTERS


@pytest.mark.parametrize(
    "code",
    [
        "print(1)",
        "typer.echo(1)",
        "sys.stderr.write('x')",
        "bar(file=sys.stderr)",
        "logging.StreamHandler()",
        "traceback.print_exc()",
    ],
)
def test_the_check_finds_printers(code: str) -> None:
    assert prints(code)
    assert not prints("console.note('x'); file.write('x')")
