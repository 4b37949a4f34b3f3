"""The ray-traced scenes of stems are what they say, and their scores count what they should."""

import numpy as np
import pytest

from benchmarks.metres import run
from benchmarks.metres.rows import ROWS
from benchmarks.metres.rows.clean import stand, stem
from benchmarks.metres.scores import lines, score
from calib import pixels_to_rays
from edgetree.measure import Estimate, TreeMeasurement


@pytest.mark.parametrize("row", sorted(ROWS))
def test_a_row_yields_measurements_with_their_true_values(row):
    readings = [pair for seed in (0, 2) for pair in ROWS[row](np.random.default_rng(seed))]
    assert readings
    for tree, truth in readings:
        assert isinstance(tree, TreeMeasurement)
        assert 0.02 < truth["diameter_m"] < 1.0
        assert truth["distance_m"] >= truth["axis_distance_m"] > 1.0


def test_an_unknown_row_is_named_beside_those_that_there_are(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["run", "forks"])
    with pytest.raises(SystemExit):
        run.main()
    error = capsys.readouterr().err
    assert "no row is called forks" in error
    assert "fork-alone" in error


def test_depth_on_a_stem_lies_on_its_surface():
    rng = np.random.default_rng(5)
    frame = stand(rng, [stem(rng, oval=1.0, taper=0.0)])
    rows, columns = np.nonzero(frame.owner == 1)
    rays = pixels_to_rays(frame.camera, np.stack([columns, rows], -1) + 0.5)
    points = rays * frame.depth_m[rows, columns][:, None]
    cone = frame.cones[0]
    apart = np.linalg.norm(np.cross(points - cone.start_m, cone.along), axis=1)
    assert apart == pytest.approx(np.full(len(apart), cone.radius_m), abs=1e-4)


def test_the_girth_of_an_oval_section_is_that_of_its_ellipse():
    rng = np.random.default_rng(6)
    cone = stand(rng, [stem(rng, oval=1.3, taper=0.0)]).cones[0]
    longer, shorter = cone.radius_m * 1.3**0.5, cone.radius_m / 1.3**0.5
    share = ((longer - shorter) / (longer + shorter)) ** 2
    ramanujan = (longer + shorter) * (1 + 3 * share / (10 + (4 - 3 * share) ** 0.5))
    assert cone.girth_diameter_m(1.0) == pytest.approx(ramanujan, rel=1e-4)


def test_scores_count_what_is_given_and_what_is_beyond():
    failed = TreeMeasurement.failed("no depth")
    given = TreeMeasurement(**{**vars(failed), "diameter_m": Estimate(0.3, 0.01)})
    truths = [{"diameter_m": each} for each in (0.301, 0.295, 0.24)]
    scores = score([(given, truth) for truth in truths] + [(failed, truths[0])])["diameter_m"]
    assert (scores["stems"], scores["given"]) == (4, 3)
    assert scores["beyond3"] == pytest.approx(1 / 3, abs=1e-4)
    assert scores["inside"][3] == pytest.approx(2 / 3, abs=1e-3)
    assert "3/4" in lines("row", {"diameter_m": scores})[1]
