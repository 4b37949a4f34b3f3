"""The command line of a program, and where its result goes."""

from __future__ import annotations

import argparse
import json
import platform
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from basetree.files.writing import write_text

Record = dict[str, Any]


def command_line(doc: str | None) -> argparse.ArgumentParser:
    """A parser with the text at the top of a program as its help."""
    form = argparse.RawDescriptionHelpFormatter
    return argparse.ArgumentParser(description=doc, formatter_class=form)


def program(doc: str | None) -> argparse.ArgumentParser:
    """The same with the option --result."""
    parser = command_line(doc)
    parser.add_argument("--result", type=Path, help="JSON file for the result")
    return parser


def finish(result: Record, path: Path | None) -> None:
    """Print a result as JSON, and write it to a file if one is given."""
    text = json.dumps(result, indent=1, ensure_ascii=False) + "\n"
    sys.stdout.write(text)
    if path is not None:
        write_text(path, text)


def read_record(path: Path | None) -> Record:
    """The result in a file; empty if there is none."""
    if path is None or not path.is_file():
        return {}
    record: Record = json.loads(path.read_text("utf-8"))
    return record


def made_once(path: Path, make: Callable[[], Record]) -> Record:
    """The record in a file; without the file it is made, and written."""
    if not path.is_file():
        write_text(path, json.dumps(make()))
    return read_record(path)


def machine() -> str:
    """Processor of this machine, as far as the system tells."""
    return platform.processor() or platform.machine()


def note(*words: object) -> None:
    """Print a line of progress on stderr."""
    sys.stderr.write(" ".join(map(str, words)) + "\n")
