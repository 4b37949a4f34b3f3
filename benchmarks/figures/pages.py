"""Put tables into pages, between `<!-- figures: NAME -->` and `<!-- end of figures -->`."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
RESULTS = ROOT / "benchmarks" / "results"
CARDS = (ROOT / "edgetree" / "assets" / "models", ROOT / "models")
END = "<!-- end of figures -->"
_PLACE = re.compile(rf"^<!-- figures: ([\w-]+) -->\n.*?^{END}$", re.DOTALL | re.MULTILINE)

Record = dict[str, Any]


def stored(name: str) -> Record:
    """A result of `benchmarks/results`, by its name without the ending."""
    record: Record = json.loads((RESULTS / f"{name}.json").read_text("utf-8"))
    return record


def card(name: str) -> Record:
    """The card of a model of the package, or of the folder `models`."""
    path = next(path for folder in CARDS if (path := folder / f"{name}.json").is_file())
    record: Record = json.loads(path.read_text("utf-8"))
    return record


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    """The lines of a table in Markdown."""
    yield f"| {' | '.join(head)} |"
    yield f"|{' --- |' * len(head)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def pages() -> list[Path]:
    """The pages that hold tables from stored results."""
    return [path for path in sorted((ROOT / "docs").rglob("*.md")) if _PLACE.search(read(path))]


def read(path: Path) -> str:
    """The text of a page."""
    return path.read_text("utf-8")


def names(text: str) -> list[str]:
    """The names of the tables in a page."""
    return _PLACE.findall(text)


def filled(text: str, tables: Mapping[str, Sequence[str]]) -> str:
    """A page with its tables made anew.

    Raises:
        KeyError: If the page names a table that does not exist.
    """

    def place(found: re.Match[str]) -> str:
        lines = "\n".join(tables[found[1]])
        return f"<!-- figures: {found[1]} -->\n\n{lines}\n\n{END}"

    return _PLACE.sub(place, text)
