"""Results of a check as JSON-ready dictionaries: lengths in metres, shares between 0 and 1."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

from edgetree.check.comparison import Comparison
from edgetree.check.error_fit import ErrorFit
from edgetree.check.matching import Matching
from edgetree.check.quantities import QuantityCheck, Share
from edgetree.check.stems import CaliperStem, MeasuredStem
from edgetree.check.verdict import Verdict


def matching_record(matching: Matching) -> dict[str, Any]:
    """How the stems were matched."""
    return {
        "matched_by": matching.by,
        "matched": len(matching.pairs),
        "ambiguous": [
            {"caliper": _caliper_stem(pair.caliper), "measured": _measured_stem(pair.measured)}
            for pair in matching.ambiguous
        ],
        "caliper_only": [_caliper_stem(stem) for stem in matching.caliper_only],
        "measured_only": [_measured_stem(stem) for stem in matching.measured_only],
    }


def _caliper_stem(stem: CaliperStem) -> dict[str, Any]:
    return {"line": stem.line, "frame": stem.frame, "tree": stem.tree}


def _measured_stem(stem: MeasuredStem) -> dict[str, Any]:
    return {"frame": stem.frame, "tree": stem.tree}


def quantity_record(check: QuantityCheck) -> dict[str, Any]:
    """The comparison of one quantity."""
    return {
        "stems": len(check.comparisons),
        "not_measured": [
            {**_measured_stem(each.pair.measured), "reason": each.reason}
            for each in check.not_measured
        ],
        "mean_m": check.mean_m,
        "bias_m": check.bias_m,
        "bias_std_m": check.bias_std_m,
        "rmse_m": check.rmse_m,
        "rmse_share": check.rmse_share,
        "median_abs_error_m": check.median_abs_error_m,
        "coverage": _share(check.coverage),
        "mean_squared_standardised_error": check.mean_squared_standardised_error,
        "outliers": [_outlier(each) for each in check.outliers],
        "left_out": [
            {**_outlier(each.comparison), "cause": each.cause, "mistyped": each.mistyped}
            for each in check.gross_errors
        ],
    }


def _share(share: Share) -> dict[str, Any]:
    low, high = share.interval95
    return {
        "count": share.count,
        "total": share.total,
        "value": share.value,
        "low95": low,
        "high95": high,
    }


def _outlier(comparison: Comparison) -> dict[str, Any]:
    return {
        **_measured_stem(comparison.pair.measured),
        "line": comparison.pair.caliper.line,
        "measured_m": comparison.measured.value,
        "caliper_m": comparison.caliper.value,
        "error_m": comparison.error.value,
        "error_std_m": comparison.error.std,
    }


def fit_record(fit: ErrorFit) -> dict[str, Any]:
    """The fit of the stated errors."""
    return {
        "scale": fit.scale.value,
        "scale_std": fit.scale.std,
        "scale_significant": fit.scale_significant,
        "factor": fit.factor.value,
        "factor_std": fit.factor.std,
        "factor_significant": fit.factor_significant,
        "coverage_before": _share(fit.coverage_before),
        "coverage_after": _share(fit.coverage_after),
        "settings": fit.settings,
    }


def verdict_record(verdict: Verdict) -> dict[str, Any]:
    """The outcome, its reasons, and what the stems can show."""
    return {
        "passed": verdict.outcome == "passed",
        "outcome": verdict.outcome,
        "reasons": list(verdict.reasons),
        "missed": {"count": verdict.missed.count, "total": verdict.missed.total},
        "power": {name: asdict(each) for name, each in verdict.power.items()},
    }
