"""Make the tables of the documentation anew from the stored results.

python -m benchmarks.figures
"""

from __future__ import annotations

import sys

from basetree.files.writing import write_text
from benchmarks.figures.accuracy import TABLES as ACCURACY
from benchmarks.figures.counting import TABLES as COUNTING
from benchmarks.figures.pages import ROOT, filled, pages, read
from benchmarks.figures.paper import TABLES as PAPER
from benchmarks.tools.program import command_line

TABLES = ACCURACY | COUNTING | PAPER


def main() -> None:
    """Write each page whose tables have changed, and name it."""
    command_line(__doc__).parse_args()
    made = {name: list(make()) for name, make in TABLES.items()}
    for path in pages():
        text = filled(read(path), made)
        if text != read(path):
            write_text(path, text)
            sys.stdout.write(f"{path.relative_to(ROOT)}\n")


if __name__ == "__main__":
    main()
