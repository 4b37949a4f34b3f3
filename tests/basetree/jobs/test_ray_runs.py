"""How units are given to a cluster, against a cluster that a test controls; without Ray."""

import itertools
from collections import deque
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from basetree.jobs import Job, JobError, LocalStore, Progress, read_manifests
from basetree.jobs.on_ray import RayEngine, _Run
from basetree.jobs.running import do_unit


class RayError(Exception):
    """As Ray's: a lost worker or machine."""


class RayTaskError(RayError):
    """As Ray's: an error in a task."""

    def __init__(self, cause: Exception) -> None:
        self.cause = cause


class FakeRay:
    """A cluster that finishes what it was given in order, except for what a test says.

    Attributes:
        cores: Cores of the cluster, at each look.
        failing: Errors by unit, one for each attempt.
        slow: Units whose first attempt never ends.
        late: One of them whose first attempt ends after all, when it is given out again.
        given: Units in the order in which they were given out.
        most: Most units that were with the cluster at once.
    """

    def __init__(self, cores: list[int]) -> None:
        self.cores, self.given, self.most = deque(cores), list[int](), 0
        self.failing: dict[int, list[Exception]] = {}
        self.slow: set[int] = set()
        self.late: int | None = None
        self.stuck: set[int] = set()
        self.cancelled: list[int] = []
        self.exceptions = SimpleNamespace(RayError=RayError, RayTaskError=RayTaskError)
        self._numbers = itertools.count()
        self._units: dict[int, int] = {}

    def remote(self, **_: Any) -> Any:
        def give(sent: Any, unit: int) -> int:
            if unit == self.late and unit in self.given:
                self.stuck = {n for n in self.stuck if self._units[n] != unit}
            self.given.append(unit)
            number = next(self._numbers)
            self._units[number] = unit
            if unit in self.slow:
                self.slow.remove(unit)
                self.stuck.add(number)
            return number

        return lambda function: SimpleNamespace(remote=give)

    def put(self, content: Any) -> int:
        return -1

    def cluster_resources(self) -> dict[str, float]:
        return {"CPU": self.cores.popleft() if len(self.cores) > 1 else self.cores[0]}

    def wait(self, references: list[int], **_: Any) -> tuple[list[int], list[int]]:
        self.most = max(self.most, len(references))
        ready = [number for number in references if number not in self.stuck]
        return ready[:1], references

    def get(self, number: int) -> tuple[str, float]:
        unit = self._units[number]
        if errors := self.failing.get(unit):
            raise errors.pop()
        return f"digest {unit}", 1.0

    def cancel(self, number: int, force: bool) -> None:
        self.cancelled.append(self._units[number])


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that goes on by 0.3 s at each look."""
    now = itertools.count(0.0, 0.3)
    monkeypatch.setattr("basetree.jobs.on_ray.time.monotonic", lambda: next(now))


@pytest.fixture
def run(clock: None, job: Callable[..., Job], tmp_path: Path) -> Callable[[FakeRay], _Run]:
    """Does 24 units on a cluster."""

    def do(ray: FakeRay) -> _Run:
        whole = job(LocalStore(tmp_path), frames=24, block=1)
        found = _Run(ray, whole, lambda: bytes, 1, Progress("testing"), deque(range(24)))
        found.to_the_end()
        return found

    return do


def test_every_unit_is_done_once_and_few_are_given_at_once(run: Any) -> None:
    ray = FakeRay([3])
    assert run(ray).digests == {unit: f"digest {unit}" for unit in range(24)}
    assert sorted(ray.given) == list(range(24))
    assert ray.most == 6


def test_a_larger_cluster_is_given_more(run: Any) -> None:
    ray = FakeRay([1, 1, 8])
    run(ray)
    assert ray.most == 16


def test_what_a_lost_worker_had_is_done_again(run: Any, capsys: Any) -> None:
    ray = FakeRay([2])
    ray.failing = {5: [RayError("killed")] * 9, 6: [RayError("killed")]}
    assert len(run(ray).digests) == 24
    assert (ray.given.count(5), ray.given.count(6), ray.given.count(7)) == (10, 2, 1)
    assert "a worker was lost (RayError): its work is done again" in capsys.readouterr().err


def test_a_unit_that_always_ends_its_worker_ends_the_run(run: Any) -> None:
    ray = FakeRay([2])
    ray.failing = {5: [RayError("killed")] * 1000}
    with pytest.raises(JobError, match=r"parts/000005\.json: its worker was lost 10 times"):
        run(ray)


def test_a_slow_unit_is_given_to_another_worker_at_the_end(run: Any) -> None:
    ray = FakeRay([2])
    ray.slow = {3}
    assert len(run(ray).digests) == 24
    assert ray.given.count(3) == 2
    assert ray.cancelled == [3]


def test_a_unit_that_two_workers_finish_counts_once(run: Any) -> None:
    ray = FakeRay([4])
    ray.slow, ray.late = {3, 4}, 3
    done = run(ray)
    assert (ray.given.count(3), ray.given.count(4)) == (2, 2)
    assert done.progress.line().startswith("testing: 24 of ")


def test_a_part_that_two_workers_wrote_is_the_one_that_is_there(
    clock: None, job: Callable[..., Job], tmp_path: Path
) -> None:
    """Results have times, so that the parts of two workers differ."""
    store = LocalStore(tmp_path)
    whole = job(store, frames=24, block=1)

    class WritingRay(FakeRay):
        def get(self, number: int) -> tuple[str, float]:
            return do_unit(
                whole, lambda unit: f"unit {unit}, {number}".encode(), self._units[number]
            )

    ray = WritingRay([4])
    ray.slow, ray.late = {3, 4}, 3
    engine = object.__new__(RayEngine)
    engine._ray, engine._cores = ray, 1
    engine.run(whole, lambda: bytes, Progress("testing"))
    assert ray.given.count(3) == 2
    parts = list(read_manifests([store], ("test",)))
    assert [part.decode().partition(",")[0] for part in parts] == [f"unit {n}" for n in range(24)]


def test_a_cluster_without_cores_is_waited_for(run: Any, capsys: Any) -> None:
    assert len(run(FakeRay([0, 0, 2])).digests) == 24
    told = capsys.readouterr().err
    assert told.count("the cluster has 0 cores, a unit needs 1: waiting for machines to join") == 1


def test_an_error_for_the_user_is_raised_as_it_is(run: Any) -> None:
    ray = FakeRay([2])
    ray.failing = {3: [RayTaskError(JobError("no model there"))]}
    with pytest.raises(JobError, match=r"^no model there$"):
        run(ray)
    ray = FakeRay([2])
    ray.failing = {3: [RayTaskError(ModuleNotFoundError("No module named 'fleet'"))]}
    with pytest.raises(JobError, match=r"cannot start a worker .*expected the same installation"):
        run(ray)
    ray = FakeRay([2])
    ray.failing = {3: [RayTaskError(KeyError("a bug"))]}
    with pytest.raises(RayTaskError):
        run(ray)
