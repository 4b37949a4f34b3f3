"""Tables of caliper readings."""

from __future__ import annotations

from edgetree.check.csv_file import read_csv
from formats.form import Format

_CSV = b"stem;diameter (cm);distance_m\n1;31,4;5\n2;20;\n"

FORMATS = {
    "stems.csv": Format((_CSV,), read_csv),
}
