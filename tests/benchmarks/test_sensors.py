"""Stems in front of cameras of other sizes and kinds, by the packaged depth files."""

import numpy as np
import pytest

from benchmarks.sensors.control import SENSORS, draw
from benchmarks.sensors.views import OUTLINES, readings

SEEDS = range(1000, 1006)


def errors_m(size, sensor, source):
    pairs = [
        pair
        for seed in SEEDS
        for pair in readings(draw(np.random.default_rng(seed), size, sensor), source)
    ]
    given = [(tree.dbh_m, truth["dbh_m"]) for tree, truth in pairs if tree.dbh_m]
    assert len(given) >= 0.6 * len(pairs)
    inside = [low < true < high for (low, high), true in ((v.interval95, t) for v, t in given)]
    return np.array([value.value - true for value, true in given]), np.mean(inside)


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("size", [(640, 480), (256, 192)])
def test_networks_outlines_follow_the_depth(size, sensor):
    error_m, inside = errors_m(size, sensor, "edge-n-depth")
    assert abs(np.mean(error_m)) < (0.01 if size[0] > 300 else 0.02)
    assert inside >= 0.75


@pytest.mark.parametrize("sensor", ["stereo", "tof-2x2"])
def test_exact_outlines_have_no_bias(sensor):
    error_m, inside = errors_m((640, 480), sensor, OUTLINES)
    assert abs(np.mean(error_m)) < 0.004
    assert inside >= 0.9
