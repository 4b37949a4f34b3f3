"""Tables of caliper readings, and of the stems that are compared with them."""

from __future__ import annotations

from pathlib import Path

from edgetree.check import CaliperStem, CaliperTable, compare, read_caliper, read_measured
from edgetree.check.csv_file import read_csv
from edgetree.measure import Estimate
from formats.form import Format

_CSV = b"stem;diameter (cm);distance_m\n1;31,4;5\n2;20;\n"
_TREES = range(1, 25)
_NAMES = ("diameter", "dbh", "cut_height")
_HEADER = ",".join(
    ("frame", "tree", *(f"{name}{end}" for name in _NAMES for end in ("_m", "_std_m")))
)
_POINTS = ",".join(f"cut_point_machine_{axis}_m" for axis in "xyz")
_MEASURED = "".join(
    (
        f"{_HEADER},{_POINTS}\n",
        *(f"a,{tree},0.3{tree:02},0.01,0.3,0.02,0.1,0.1,{tree},2,0.5\n" for tree in _TREES),
    )
).encode()
_BY_NUMBER = "".join(
    ("tree\tdiameter_cm\tdbh_mm\tdiameter_std_cm\n", *(f"{n}\t31,{n}\t300\t0,5\n" for n in _TREES))
)
_BY_PLACE = "".join(("x_m,y_m,diameter_in\n", *(f"{tree},2.1,12\n" for tree in _TREES)))


def _compare_caliper(path: Path) -> object:
    measured = path.with_name("measured.csv")
    measured.write_bytes(_MEASURED)
    return compare(read_measured(measured), read_caliper(path)).to_dict()


def _compare_measured(path: Path) -> object:
    stems = [CaliperStem(n, {"diameter_m": Estimate(0.3, 0.005)}, None, n) for n in _TREES]
    return compare(read_measured(path), CaliperTable("caliper.csv", tuple(stems))).to_dict()


FORMATS = {
    "stems.csv": Format((_CSV,), read_csv),
    "caliper.csv": Format(
        (_BY_NUMBER.encode(), _BY_NUMBER.encode("utf-16"), _BY_PLACE.encode()), _compare_caliper
    ),
    "measured.csv": Format((_MEASURED,), _compare_measured),
}
