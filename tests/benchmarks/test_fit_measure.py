"""The fit of the measurement's constants, on errors whose true size is known."""

import numpy as np
import pytest

pytest.importorskip("pycocotools")

from benchmarks import fit_measure
from benchmarks.fit_cases import Reading
from edgetree.measure import constants, width


class Frame:
    """A frame of which the true error of every value is 3, and the stated one depends on STD."""

    def __init__(self, scene: int) -> None:
        self.scene = scene
        self.errors = np.random.default_rng(scene).normal(0, 3.0, 40)

    def readings(self, quantity, source, settings):
        assert (quantity, source) == ("dbh_m", "labels")
        std = settings["out_of_round_std"]
        return [Reading((n, 0), error, std) for n, error in enumerate(self.errors)]


def test_the_fitted_error_is_the_true_one():
    frames = [Frame(scene) for scene in range(60)]
    found = fit_measure.fit_constant(frames, "dbh-labels", "out_of_round_std", 2.0)
    assert found["new"] == pytest.approx(3.0, rel=0.15)
    assert 0.02 < found["std"] < 0.6
    assert (found["readings"], found["scenes"]) == (2400, 60)
    others = [Frame(scene) for scene in range(100, 160)]
    tested = fit_measure.compare(others, "dbh-labels", "out_of_round_std", 2.0, 3.0)
    assert tested["inside_old"] < 0.85
    assert tested["inside_new"] == pytest.approx(0.95, abs=0.02)
    assert tested["gain"] > 5 * tested["gain_std"] > 0


def test_a_constant_is_set_where_it_is_used_and_set_back():
    value = width.SHAPE_STD_PER_M
    with fit_measure.constant("SHAPE_STD_PER_M", 0.5) as settings:
        assert (settings, width.SHAPE_STD_PER_M) == ({}, 0.5)
    assert value == width.SHAPE_STD_PER_M == constants.stems.SHAPE_STD_PER_M


def test_every_fit_names_a_quantity_and_what_is_measured():
    fitted = fit_measure.constants()
    assert len(fitted) > 30
    for name, fit, _ in fitted:
        quantity, source = fit_measure.measured_as(fit)
        assert quantity in fit_measure.QUANTITIES.values(), name
        assert source in fit_measure.SOURCES, name
