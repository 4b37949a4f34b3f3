"""Testing claims: confirmed, contradicted or undecided."""

import statistics

import pytest

from perceptree.tables.verdict import judge, pooled_deviation

CLOSE, FAR, WIDE = (50.0, 50.2), (60.0, 60.2), (40.0, 60.0)


def test_deviations_are_pooled_by_their_degrees_of_freedom() -> None:
    groups = [(1.0, 3.0), (10.0, 10.0, 13.0), (7.0,), ()]
    deviation, freedom = pooled_deviation(groups)
    assert freedom == 3
    assert deviation == pytest.approx((8.0 / 3) ** 0.5)  # squares about the means: 2 and 6
    assert pooled_deviation([(1.0,), (2.0,)]) == (0.0, 0)


@pytest.mark.parametrize(
    ("scores", "others", "rises", "word"),
    [
        (FAR, CLOSE, True, "agrees"),
        (CLOSE, FAR, True, "disagrees"),
        (CLOSE, FAR, False, "agrees"),
        (FAR, CLOSE, False, "disagrees"),
        (FAR, WIDE, True, "undecided"),
        ((50.1, 50.3), CLOSE, True, "undecided"),
        ((60.0,), CLOSE, True, "undecided"),
        ((60.0,), (50.0,), True, "undecided"),
        ((0.0, 0.0), (0.0, 0.0), True, "undecided"),
        ((), CLOSE, True, "undecided"),
    ],
)
def test_the_verdict(scores: tuple[float], others: tuple[float], rises: bool, word: str) -> None:
    found = judge(scores, others, [scores, others], rises)
    assert found.word == word
    if scores:
        assert found.difference == pytest.approx(
            statistics.fmean(scores) - statistics.fmean(others)
        )
    assert (found.interval is None) == (min(len(scores), len(others)) < 2)


def test_the_interval_uses_students_t() -> None:
    """Two runs each: the textbook's two-sample test, t(2) = 4.303."""
    found = judge((3.0, 5.0), (1.0, 2.0), [(3.0, 5.0), (1.0, 2.0)])
    assert found.interval == pytest.approx(4.303 * ((2.0 + 0.5) / 2) ** 0.5)
    assert found.word == "undecided"


def test_other_rows_add_degrees_of_freedom() -> None:
    pair = [(50.0, 50.4), (51.2, 51.6)]
    assert judge(pair[1], pair[0], pair).word == "undecided"
    calm = [(20.0, 20.4), (30.0, 30.4), (40.0, 40.4)]
    assert judge(pair[1], pair[0], pair + calm).word == "agrees"
    noisy = [(20.0, 25.0), (30.0, 35.0)]
    assert judge(pair[1], pair[0], pair + noisy).word == "undecided"
