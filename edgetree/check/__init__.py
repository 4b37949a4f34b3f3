"""Compare measured stems with a caliper's: bias, scatter, and whether the stated errors hold."""

from edgetree.check.acceptance import CheckResult, compare
from edgetree.check.comparison import Comparison
from edgetree.check.error_fit import ErrorFit, fit_errors
from edgetree.check.gross import GrossError
from edgetree.check.matching import Matching, Pair, match_stems
from edgetree.check.plot import draw_check
from edgetree.check.quantities import NotMeasured, QuantityCheck, Share
from edgetree.check.stems import (
    CaliperStem,
    CaliperTable,
    MeasuredStem,
    MeasuredTable,
    read_caliper,
    read_measured,
)
from edgetree.check.verdict import Power, Verdict

__all__ = [
    "CaliperStem",
    "CaliperTable",
    "CheckResult",
    "Comparison",
    "ErrorFit",
    "GrossError",
    "Matching",
    "MeasuredStem",
    "MeasuredTable",
    "NotMeasured",
    "Pair",
    "Power",
    "QuantityCheck",
    "Share",
    "Verdict",
    "compare",
    "draw_check",
    "fit_errors",
    "match_stems",
    "read_caliper",
    "read_measured",
]
