"""Fit the constants of the measurement to simulated frames, and test them on others.

python -m benchmarks.fit_measure --data FOLDER --result benchmarks/results/fit_measure.json

Fitted are the constants of `edgetree.measure.constants` whose source is "fitted (QUANTITY-SOURCE)",
and some of `MeasureSettings`. Each is fitted alone, while the others stay as they are. Its value is
the one with the least interval score of the quantity's 95 % intervals (Gneiting and Raftery 2007,
Strictly proper scoring rules, prediction, and estimation): their width, plus 40 times the distance
of true values outside. It is least where 95 % of the true values are inside intervals that are as
narrow as can be. Each score is in units of today's standard deviation of the value.

SOURCE says what is measured: exact outlines ("labels"), those of `edge-n-depth` ("network"), or the
same without a given vertical. The standard deviation of a fitted value is that of a bootstrap over
the scenes.

The frames are of the presets `paper` and `field` (seed 909, 100 frames each). Old and new values
are compared on 400 frames of `test` and `field-test`. They are simulated into the folder if it does
not hold them, in half an hour of two cores; the fit takes as long on one. No constant changes by
this program: a new value is worth it if its gain on the other frames is clear.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from basetree.arrays import Bool, Float, Index
from benchmarks.fit_cases import Case, read_all, say
from benchmarks.measure import SIMULATED
from edgetree import TreeDetector
from edgetree.catalogue import find_model
from edgetree.measure.constants.entries import TOPICS, entries

FIT_FRAMES = (("paper", 909, 100), ("field", 909, 100))
TEST_FRAMES = (("test", 44, 200), ("field-test", 45, 200))
MODEL = "edge-n-depth"
QUANTITIES = {
    "diameter": "diameter_m",
    "dbh": "dbh_m",
    "profile": "profile",
    "taper": "taper_cm_per_m",
    "cut-height": "cut_height_m",
    "distance": "distance_m",
    "axis-distance": "axis_distance_m",
    "inclination": "inclination_deg",
}
SOURCES = ("labels", "network", "no-vertical")
SETTINGS = {
    "keypoint_heat": "diameter-network",
    "keypoint_heat_slide": "distance-network",
    "mask_std_px": "diameter-network",
    "mask_spread": "diameter-network",
    "depth_bias_per_m": "distance-labels",
    "outline_doubt": "diameter-network",
    "readings_doubt": "diameter-network",
    "butt_swell": "diameter-network",
    "butt_swell_std": "diameter-network",
    "out_of_round_std": "diameter-labels",
    "curvature_std": "diameter-labels",
    "bend_std_deg": "inclination-labels",
    "lean_std_deg": "inclination-no-vertical",
}
# Values are tried from a quarter to four times the one of today.
FACTORS = np.array([0.25, 0.5, 0.71, 1.0, 1.41, 2.0, 4.0])
TODAY = int(np.flatnonzero(FACTORS == 1.0)[0])
BOOTSTRAPS = 300
# Half the width of a 95 % interval in standard deviations, and the price of what is outside.
HALF_WIDTH, PRICE = 1.96, 2 / 0.05
# A reading depends on a constant if its value or its stated error changes by this share of the
# stated error.
CHANGED = 0.01


class Errors:
    """Errors of the same readings for several values of a constant.

    Attributes:
        scene: (N,) numbers of the scenes.
        error: (V, N) errors, for each of V values.
        std: (V, N) stated standard deviations.
    """

    def __init__(self, cases: list[Case], runs: list[list[dict[tuple[int, int], Any]]]) -> None:
        """Keep the readings that every run has; `runs` hold them by their keys, for each case."""
        scenes, errors, stds = [], [], []
        for number, case in enumerate(cases):
            of_case = [run[number] for run in runs]
            for key in of_case[0]:
                if all(key in run for run in of_case):
                    scenes.append(case.scene)
                    errors.append([run[key].error for run in of_case])
                    stds.append([run[key].std for run in of_case])
        self.scene = np.array(scenes)
        self.error, self.std = np.array(errors).T, np.array(stds).T

    def scores(self, today: int) -> Float:
        """(V, N) interval scores, in standard deviations stated with the value number `today`."""
        half = HALF_WIDTH * self.std
        outside = np.maximum(np.abs(self.error) - half, 0.0)
        return np.asarray((2 * half + PRICE * outside) / self.std[today])

    def inside(self, chosen: Bool) -> list[float]:
        """(V,) shares of the chosen readings (N,) inside their 95 % intervals."""
        held = np.abs(self.error) <= HALF_WIDTH * self.std
        return [round(float(share), 4) for share in held[:, chosen].mean(1)]

    def changed(self) -> Bool:
        """(N,) whether a reading depends on the constant."""
        moved = np.ptp(self.std, axis=0) + np.ptp(self.error, axis=0)
        return np.asarray(moved > CHANGED * self.std.min(0))


@contextmanager
def constant(name: str, value: float) -> Iterator[dict[str, float]]:
    """Set a constant in every module that uses it; yields the changes of settings, if it is one."""
    if name in SETTINGS:
        yield {name: value}
        return
    users = [
        module
        for path, module in sys.modules.items()
        if path.startswith("edgetree.measure.") and name in vars(module)
    ]
    before = vars(users[0])[name]
    for module in users:
        setattr(module, name, value)
    try:
        yield {}
    finally:
        for module in users:
            setattr(module, name, before)


def measured_as(fit: str) -> tuple[str, str]:
    """The quantity of a fit, as in `TreeMeasurement`, and its source."""
    source = next(source for source in SOURCES if fit.endswith(f"-{source}"))
    return QUANTITIES[fit.removesuffix(f"-{source}")], source


def run(cases: list[Case], fit: str, name: str, value: float) -> list[dict[tuple[int, int], Any]]:
    """The readings of each case, with one value of a constant."""
    quantity, source = measured_as(fit)
    with constant(name, value) as settings:
        return [
            {each.key: each for each in case.readings(quantity, source, settings)} for case in cases
        ]


def best(values: Float, scores: Float) -> float:
    """The value with the least score, from a parabola through the three scores around the least."""
    index = int(scores.argmin())
    if index in (0, len(values) - 1):
        return float(values[index])
    near = slice(index - 1, index + 2)
    square, slope, _ = np.polyfit(np.log(values[near]), scores[near], 2)
    return float(np.exp(-slope / (2 * square)))


def fit_constant(cases: list[Case], fit: str, name: str, old: float) -> dict[str, Any]:
    """The best value of a constant, with its standard deviation and number of readings."""
    values = old * FACTORS
    errors = Errors(cases, [run(cases, fit, name, value) for value in values])
    changed = errors.changed()
    if not changed.any():
        return {"new": old, "std": None, "readings": 0, "scenes": 0, "inside_fit": None}
    scenes, place = np.unique(errors.scene[changed], return_inverse=True)
    scores = np.array([np.bincount(place, each) for each in errors.scores(TODAY)[:, changed]])
    rng = np.random.default_rng(0)
    drawn: Index = rng.integers(0, len(scenes), (BOOTSTRAPS, len(scenes)))
    again = [best(values, scores[:, rows].sum(1)) for rows in drawn]
    new = best(values, scores.sum(1))
    return {
        "new": float(f"{new:.3g}"),
        "std": float(f"{np.std(again):.2g}"),
        "at_end_of_range": bool(new in (values[0], values[-1])),
        "readings": int(changed.sum()),
        "scenes": len(scenes),
        "inside_fit": errors.inside(changed)[TODAY],
    }


def compare(cases: list[Case], fit: str, name: str, old: float, new: float) -> dict[str, Any]:
    """Old and new value on other frames: shares inside, and the gain by the objective."""
    errors = Errors(cases, [run(cases, fit, name, value) for value in (old, new)])
    changed = errors.changed()
    if not changed.any():
        return {"test_readings": 0}
    place = np.unique(errors.scene[changed], return_inverse=True)[1]
    scores = errors.scores(0)[:, changed]
    gains = np.bincount(place, scores[0] - scores[1])
    count = int(changed.sum())
    return {
        "test_readings": count,
        "inside_old": errors.inside(changed)[0],
        "inside_new": errors.inside(changed)[1],
        "gain": round(float(gains.sum()) / count, 4),
        "gain_std": round(float(np.sqrt((gains**2).sum())) / count, 4),
    }


def constants() -> list[tuple[str, str, float]]:
    """Name, fit and value of every constant that is fitted."""
    usual = SIMULATED
    of_table = [
        (entry.name, entry.fit, entry.value)
        for topic in TOPICS.values()
        for entry in entries(topic)
        if entry.fit is not None
    ]
    return of_table + [(name, fit, getattr(usual, name)) for name, fit in SETTINGS.items()]


def main() -> None:
    """Fit and test every constant, print the values, and write them to a file."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of the datasets")
    parser.add_argument("--result", type=Path)
    options = parser.parse_args()
    detector = TreeDetector.load(find_model(MODEL), threads=1, score_threshold=0.5)

    fitting, testing = (
        read_all(options.data, chosen, detector) for chosen in (FIT_FRAMES, TEST_FRAMES)
    )
    say("constant, fit: old, new ± standard deviation (readings); inside 95 % on other frames")
    results = {}
    for name, fit, old in constants():
        found = fit_constant(fitting, fit, name, old)
        found |= compare(testing, fit, name, old, found["new"]) if found["readings"] else {}
        results[name] = {"fit": fit, "old": old, **found}
        say(
            f"{name}, {fit}: {old:.4g}, {found['new']:.4g} ± {found['std']} ({found['readings']});"
            f" {found.get('inside_old')} -> {found.get('inside_new')},"
            f" gain {found.get('gain')} ± {found.get('gain_std')}"
        )
    report = {
        "model": MODEL,
        "fit_frames": [f"{preset}, seed {seed}, {count}" for preset, seed, count in FIT_FRAMES],
        "test_frames": [f"{preset}, seed {seed}, {count}" for preset, seed, count in TEST_FRAMES],
        "constants": results,
    }
    if options.result is not None:
        options.result.write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
