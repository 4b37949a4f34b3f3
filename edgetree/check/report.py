"""The result of a check as text for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

from basetree.counts import counted
from edgetree.check.acceptance import CheckResult
from edgetree.check.comparison import Comparison
from edgetree.check.error_fit import ErrorFit
from edgetree.check.gross import GrossError
from edgetree.check.matching import Matching
from edgetree.check.quantities import QuantityCheck, Share
from edgetree.check.verdict import SMALL_BIAS, WANTED_POWER, Power, bias_interval
from edgetree.measure import Failure

QUANTITY_NAMES: Final = {
    "diameter_m": "diameter",
    "dbh_m": "DBH",
    "cut_height_m": "cut height",
}
"""The compared quantities in words."""

_MOST_NAMES: Final = 10
# A median ratio of measured and caliper's diameters beyond this hints at a wrong unit.
_UNLIKELY: Final = 1.8
_LABEL_WIDTH: Final = 22
_BY: Final = {
    "number": "by frame and tree number",
    "machine position": "by position in the machine's frame, within {limit:g} m",
    "camera position": "by position in the camera's frame, within {limit:g} m",
}


def report_lines(result: CheckResult) -> Iterator[str]:
    """The lines of the report, for readers without knowledge of statistics."""
    yield from _matching_lines(result.matching, result.max_distance_m)
    for check in result.quantities.values():
        yield ""
        yield from _quantity_lines(check, result.verdict.power.get(check.quantity))
    for quantity, reason in result.not_compared.items():
        yield ""
        yield f"{QUANTITY_NAMES[quantity]}: {reason}"
    yield ""
    yield from _fit_lines(result.fit)
    yield ""
    verdict = result.verdict
    if verdict.missed.count:
        yield (
            f"{verdict.missed.count} of {counted(verdict.missed.total, 'stem')} of the"
            " caliper have no"
            " diameter of the machine"
        )
    for reason in verdict.reasons:
        yield f"result: {verdict.outcome}: {reason}"
    if verdict.outcome == "passed":
        yield "result: passed"


def _matching_lines(matching: Matching, limit_m: float) -> Iterator[str]:
    yield f"{counted(len(matching.pairs), 'stem')} matched {_BY[matching.by].format(limit=limit_m)}"
    pairs = [f"{each.caliper.name} and {each.measured.name}" for each in matching.ambiguous]
    yield from _names("left out, because another stem is about as near", pairs)
    yield from _names(
        "caliper readings without a measured stem", [each.name for each in matching.caliper_only]
    )
    yield from _names(
        "measured stems without a caliper reading", [each.name for each in matching.measured_only]
    )


def _names(what: str, names: Sequence[str]) -> Iterator[str]:
    if names:
        more = len(names) - _MOST_NAMES
        shown = [*names[:_MOST_NAMES], *([f"and {more} more"] if more > 0 else [])]
        yield f"{what} ({len(names)}): {'; '.join(shown)}"


def _quantity_lines(check: QuantityCheck, power: Power | None) -> Iterator[str]:
    name = QUANTITY_NAMES[check.quantity]
    yield f"{name}: {counted(len(check.comparisons), 'stem')}"
    yield _line("mean error", _bias_text(check))
    share, mean_cm = check.rmse_share, check.mean_m * 100
    of_mean = "" if share is None else f", {share * 100:.1f} % of the mean of {mean_cm:.1f} cm"
    yield _line("root mean square", f"{check.rmse_m * 100:.1f} cm{of_mean}")
    yield _line("median error", f"{check.median_abs_error_m * 100:.1f} cm, without its sign")
    yield _line("95 % intervals", f"hold {_share_text(check.coverage)}")
    yield _line(
        "squared error",
        f"{check.mean_squared_standardised_error:.2f} times the stated one (1 is right)",
    )
    if power is not None:
        yield _line("power", _power_text(power))
    for error in check.gross_errors:
        yield from _gross_lines(error)
    for each in check.outliers:
        yield _line("outlier", _outlier(each))
    for missing in check.not_measured:
        yield _line("not measured", f"{missing.pair.measured.name}: {missing.reason}")
    ratio = check.median_ratio
    if check.quantity != "cut_height_m" and not 1 / _UNLIKELY < ratio < _UNLIKELY:
        yield _line("caliper's unit?", f"measured values are typically {ratio:.2g} times the")
        yield _line("", "caliper's: is its unit right, and are they diameters, not circumferences?")


def _bias_text(check: QuantityCheck) -> str:
    text, std_m = f"{check.bias_m * 100:+.1f}", check.bias_std_m
    if std_m is None:
        return f"{text} cm"
    text = f"{text} ± {std_m * 100:.1f} cm"
    if check.quantity == "cut_height_m":
        return text
    low, high = bias_interval(check)
    return f"{text}; in the long run {low * 100:+.1f} to {high * 100:+.1f} % of the diameter"


def _power_text(power: Power) -> str:
    seen = (
        f"with {counted(power.stems, 'stem')}, a bias of {SMALL_BIAS * 100:g} % would be seen in"
        f" {power.small_bias * 100:.0f} of 100 cases"
    )
    if power.small_bias >= WANTED_POWER or power.stems < 2:
        return seen
    return f"{seen}; {WANTED_POWER * 100:g} need {power.needed_small} stems"


def _gross_lines(error: GrossError) -> Iterator[str]:
    yield _line("left out", _outlier(error.comparison))
    counted = "" if error.mistyped else "; counts as not held"
    yield _line("", f"line {error.comparison.pair.caliper.line}: {error.cause}{counted}")


def _line(label: str, text: str) -> str:
    return f"  {label:<{_LABEL_WIDTH}}{text}"


def _share_text(share: Share) -> str:
    low, high = share.interval95
    return (
        f"{share.count} of {share.total} caliper readings ({share.value * 100:.0f} %; in the long"
        f" run {low * 100:.0f} to {high * 100:.0f} %)"
    )


def _outlier(comparison: Comparison) -> str:
    measured, caliper = comparison.measured, comparison.caliper
    return (
        f"{comparison.pair.measured.name}: measured {measured.value * 100:.1f}"
        f" ± {measured.std * 100:.1f} cm, caliper {caliper.value * 100:.1f} cm"
    )


def _fit_lines(fit: ErrorFit | Failure) -> Iterator[str]:
    if isinstance(fit, Failure):
        yield f"stated errors not fitted: {fit.reason}"
        return
    yield f"stated errors of the diameter, fitted to {counted(fit.coverage_before.total, 'stem')}:"
    yield _line("scale", f"{fit.scale.value:.3f} ± {fit.scale.std:.3f}, {_scale_words(fit)}")
    yield _line("factor", f"{fit.factor.value:.2f} ± {fit.factor.std:.2f}, {_factor_words(fit)}")
    yield _line("intervals as stated", f"hold {_share_text(fit.coverage_before)}")
    yield _line("with the fit", f"hold {_share_text(fit.coverage_after)};")
    yield _line("", "each stem is judged by a fit to the other stems")
    if fit.scale_significant:
        yield (
            "  If the distances have the same scale, divide the depth scale by it: --depth-scale"
            f" {0.001 / fit.scale.value:.6f} in place of 0.001. Otherwise calibrate the camera."
        )
    if fit.settings:
        first = ", once the scale is corrected" if fit.scale_significant else ""
        yield f"  new settings for edgetree.measure{first}:"
        values = ", ".join(f"{name}={value:g}" for name, value in fit.settings.items())
        yield f"    settings = MeasureSettings({values})"
        yield "    measure_trees(trees, depth_m, camera, settings=settings)"


def _scale_words(fit: ErrorFit) -> str:
    if not fit.scale_significant:
        return "which may be chance"
    share = fit.scale.value - 1
    return f"the diameters are {abs(share) * 100:.1f} % too {'large' if share > 0 else 'small'}"


def _factor_words(fit: ErrorFit) -> str:
    if not fit.factor_significant:
        return "which may be chance: keep the settings"
    size = "larger" if fit.factor.value > 1 else "smaller"
    return f"the errors are {size} than stated"
