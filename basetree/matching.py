"""Match two sets of things one to one."""

from __future__ import annotations

import numpy as np

from basetree.arrays import Bool, Float, Index


def match_greedily(cost: Float, allowed: Bool) -> tuple[Index, Index]:
    """Match rows and columns one to one, the lowest cost first.

    Among equal costs, the pair of the lower row, and then of the lower column, comes first. An
    optimal assignment would give up the best match for the sake of a sum, which is wrong where one
    thing is hidden and another one is new.

    Args:
        cost: (T, M) costs of the pairs.
        allowed: (T, M) pairs that may match.

    Returns:
        Rows and columns of the pairs, by row.
    """
    candidates = np.argwhere(allowed)
    order = np.argsort(cost[allowed], kind="stable")
    rows: dict[int, int] = {}
    columns: set[int] = set()
    for row, column in candidates[order].tolist():
        if row not in rows and column not in columns:
            rows[row] = column
            columns.add(column)
    pairs = np.array(sorted(rows.items()), np.intp).reshape(-1, 2)
    return pairs[:, 0], pairs[:, 1]
