"""Matching two sets of things one to one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from basetree.matching import match_greedily

COSTS = arrays(float, st.tuples(st.integers(0, 5), st.integers(0, 5)), elements=st.integers(0, 4))


def test_the_lowest_cost_comes_first_although_another_sum_is_lower() -> None:
    rows, columns = match_greedily(np.array([[1.0, 2.0], [2.0, 9.0]]), np.ones((2, 2), bool))
    assert (rows.tolist(), columns.tolist()) == ([0, 1], [0, 1])


def test_pairs_that_may_not_match_do_not() -> None:
    allowed = np.array([[False, True], [False, True]])
    rows, columns = match_greedily(np.array([[0.0, 2.0], [0.0, 1.0]]), allowed)
    assert (rows.tolist(), columns.tolist()) == ([1], [1])


@given(COSTS)
def test_nothing_is_left_over_that_could_match(cost: np.ndarray) -> None:
    allowed = cost < 3
    rows, columns = match_greedily(cost, allowed)
    assert len(set(rows.tolist())) == len(set(columns.tolist())) == len(rows)
    assert allowed[rows, columns].all()
    free = allowed.copy()
    free[rows], free[:, columns] = False, False
    assert not free.any()
    assert (np.diff(rows) > 0).all()
