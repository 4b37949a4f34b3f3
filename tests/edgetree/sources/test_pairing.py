"""Pairs of colour and depth by their stamps, in any order of arrival."""

from __future__ import annotations

import random
from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from edgetree.sources.bags.pairing import Pairing, Picture, StampCheck

PERIOD_NS = 100_000_000
MS = 1_000_000


def pairs_of(
    arrivals: list[tuple[str, float]], counts: Counter[str] | None = None
) -> list[tuple[float, float]]:
    """The stamps of the pairs, ms; arrivals are roles and stamps."""
    stamps = {"colour": StampCheck(), "depth": StampCheck()}
    pairing = Pairing(stamps, PERIOD_NS, Counter() if counts is None else counts)
    pairs = []
    for role, at_ms in arrivals:
        picture = Picture(round(at_ms * MS), round(at_ms * MS), None)
        state = stamps[role].see(picture.stamp)
        assert state in ("good", "jump")
        pairs += pairing.add(role, picture, is_jump=state == "jump")
    pairs += pairing.finish()
    found = []
    for colour, depth in pairs:
        assert colour is not None
        assert depth is not None
        found.append((colour.stamp / MS, depth.stamp / MS))
    return found


def test_of_two_candidates_the_nearer_one_is_taken() -> None:
    steady = [(role, 1000 + 100 * n) for n in range(5) for role in ("colour", "depth")]
    arrivals = [*steady, ("depth", 1465), ("depth", 1498), ("colour", 1500), ("depth", 1600)]
    assert pairs_of(arrivals)[-1] == (1500, 1498)


def test_nothing_is_paired_across_a_jump_of_the_clock() -> None:
    before = [("colour", 5000), ("depth", 5000), ("colour", 5100), ("colour", 5200)]
    after = [(role, 1000 + 100 * n) for n in range(3) for role in ("colour", "depth")]
    counts = Counter[str]()
    assert pairs_of(before + after, counts) == [
        (5000, 5000),
        *((1000 + 100 * n, 1000 + 100 * n) for n in range(3)),
    ]
    assert counts == {"colour without depth": 2}


def test_topics_of_different_rates() -> None:
    colours = [("colour", 33.0 * n) for n in range(30)]
    depths = [("depth", 99.0 * n + 5) for n in range(10)]
    counts = Counter[str]()
    pairs = pairs_of(sorted(colours + depths, key=lambda entry: entry[1]), counts)
    assert pairs == [(99.0 * n, 99.0 * n + 5) for n in range(10)]
    assert counts == {"colour without depth": 20}


@given(
    delay_ms=st.floats(-40, 40),
    lag=st.integers(0, 400),
    missing=st.sets(st.integers(0, 39), max_size=10),
    seed=st.integers(0, 100),
)
def test_every_picture_is_paired_or_counted(
    delay_ms: float, lag: int, missing: set[int], seed: int
) -> None:
    """Depth of another delay, later arrival and with gaps finds the colour of its moment."""
    jitter = random.Random(seed)
    colours = [("colour", 100.0 * n, 100.0 * n) for n in range(40)]
    depths = [
        ("depth", stamp, stamp + lag)
        for n in range(40)
        if n not in missing
        for stamp in [100.0 * n + delay_ms + jitter.uniform(-3, 3)]
    ]
    arrivals = sorted(colours + depths, key=lambda entry: entry[2])
    counts = Counter[str]()
    pairs = pairs_of([(role, stamp) for role, stamp, _ in arrivals], counts)
    assert [colour for colour, _ in pairs] == [100.0 * n for n in range(40) if n not in missing]
    assert max((abs(colour - depth) for colour, depth in pairs), default=0) < 44
    assert counts["colour without depth"] == len(missing)
    assert counts["depth without colour"] == 0


@pytest.mark.parametrize(
    ("stamps_ms", "expected"),
    [
        ([0, 100, 100], "late"),
        ([0, 100, 50], "late"),
        ([5000, 5100, 1000], "jump"),
        ([0, 100, 90_000], "good"),
    ],
)
def test_stamps_are_judged(stamps_ms: list[int], expected: str) -> None:
    check = StampCheck()
    assert [check.see(stamp * MS) for stamp in stamps_ms][-1] == expected
