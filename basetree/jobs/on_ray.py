"""Run jobs on a cluster of Ray: retries, lost workers, machines that leave or join, stragglers."""

from __future__ import annotations

import logging
import os
import signal
import statistics
import time
from collections import Counter, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any, Final, NoReturn

from basetree.errors import MissingPackage
from basetree.jobs.errors import JobError, install_hint
from basetree.jobs.job import Job
from basetree.jobs.manifests import write_manifest
from basetree.jobs.progress import Progress
from basetree.jobs.running import Start, Worker, do_unit
from basetree.jobs.shard import Shard

LOCAL: Final = "local"
_OBJECT_STORE_BYTES = 128 * 2**20  # only models and addresses travel; results go to the store
_MOST_LOSSES = 10
_POLL_S = 1.0
_SLOW_S, _SLOW_FACTOR = 30.0, 3.0
_WAITING_PER_SLOT = 2

_workers: dict[str, Worker] = {}  # in the processes of Ray: the worker of the last job


class RayEngine:
    """A connection to a cluster, or a cluster of this machine alone; use it with `with`.

    Args:
        address: Address of a cluster as Ray takes it, such as 10.0.0.5:6379; "local" for this
            machine.
        cores: Cores that one unit of work keeps busy.

    Raises:
        MissingPackage: If Ray is not installed.
        JobError: If there is no cluster at the address.
    """

    def __init__(self, address: str, cores: int = 1) -> None:
        self._address, self._cores = address, cores
        # Ray sends usage data to its maker, unless this is set before it is loaded.
        os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
        os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
        try:
            import ray
        except ImportError as error:
            raise MissingPackage(install_hint("--ray", "ray")) from error
        self._ray: Any = ray

    def __enter__(self) -> RayEngine:
        options: dict[str, Any] = {"address": self._address}
        if self._address == LOCAL:
            options = {"address": LOCAL, "object_store_memory": _OBJECT_STORE_BYTES}
            options |= {"num_cpus": max(self._cores, os.cpu_count() or 1)}
            options |= {"include_dashboard": False}
        handler = signal.getsignal(signal.SIGTERM)
        try:
            self._ray.init(**options, logging_level=logging.CRITICAL, log_to_driver=False)
        except (ConnectionError, RuntimeError, ValueError, TimeoutError) as error:
            raise JobError(
                f"--ray is {self._address!r}: no cluster answers there"
                f" ({' '.join(str(error).split())[:200]}); expected {LOCAL!r} or the address of a"
                " running cluster, such as 10.0.0.5:6379"
            ) from error
        finally:
            with suppress(ValueError):  # outside the main thread, where Ray sets no handler
                signal.signal(signal.SIGTERM, handler)
        return self

    def __exit__(self, *_: object) -> None:
        self._ray.shutdown()

    def run(self, job: Job, start: Start, progress: Progress) -> None:
        """Do the units of a job that are not finished, and write the manifest of all.

        Args:
            job: The job.
            start: Makes a worker; sent to the processes of the cluster.
            progress: Told of every finished unit.

        Raises:
            JobError: If the store holds parts of another job, or a unit ends its worker each time.
            StoreError: If a store cannot be read or written.
        """
        finished = job.open()
        progress.begin(job.frames, sum(job.frames_of(unit) for unit in finished))
        units = (unit for unit in range(job.units) if unit not in finished)
        run = _Run(self._ray, job, start, self._cores, progress, deque(units))
        run.to_the_end()
        # Of two workers that did the same unit, the second may have replaced the part of the first.
        sure = {unit: each for unit, each in run.digests.items() if unit not in run.copied}
        write_manifest(job, Shard(), sure)

    def call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Call a function in a process of the cluster, and return its result."""
        task = self._ray.remote(num_cpus=self._cores, max_retries=-1)(function)
        try:
            return self._ray.get(task.remote(*arguments))
        except self._ray.exceptions.RayTaskError as error:
            _raise_cause(error)


@dataclass
class _Attempt:
    """A unit that was given to the cluster."""

    unit: int
    since_s: float


@dataclass
class _Run:
    """One run over the units of a job."""

    ray: Any
    job: Job
    start: Start
    cores: int
    progress: Progress
    waiting: deque[int]
    running: dict[Any, _Attempt] = field(default_factory=dict)
    digests: dict[int, str] = field(default_factory=dict)
    losses: Counter[int] = field(default_factory=Counter)
    copied: set[int] = field(default_factory=set)
    recent_s: deque[float] = field(default_factory=lambda: deque(maxlen=200))
    slots: int = 0
    slots_at_s: float = -_POLL_S
    has_waited: bool = False

    def to_the_end(self) -> None:
        """Do all units."""
        task = self.ray.remote(
            num_cpus=self.cores, max_retries=0, max_calls=0, scheduling_strategy="SPREAD"
        )(work)
        # In a list, so that Ray hands on the reference and not the content.
        sent = [self.ray.put((self.job, self.start, version("edgetree")))]
        try:
            while self.waiting or any(a.unit not in self.digests for a in self.running.values()):
                self._count_slots()
                self._give_out(task, sent)
                ready, _ = self.ray.wait(list(self.running), num_returns=1, timeout=_POLL_S)
                for reference in ready:
                    self._take(reference, self.running.pop(reference))
        finally:
            for reference in self.running:
                with suppress(Exception):
                    self.ray.cancel(reference, force=True)

    def _count_slots(self) -> None:
        """Look how many units the cluster can do at once, as machines leave and join."""
        if time.monotonic() - self.slots_at_s < _POLL_S:
            return
        cores = self.ray.cluster_resources().get("CPU", 0)
        self.slots, self.slots_at_s = int(cores // self.cores), time.monotonic()
        if self.slots == 0 and not self.has_waited:
            self.has_waited = True
            self.progress.say(
                f"the cluster has {cores:.0f} cores, a unit needs {self.cores}: waiting for"
                " machines to join"
            )

    def _give_out(self, task: Any, sent: list[Any]) -> None:
        """Keep the cluster busy: first with units, in the end with copies of slow ones."""
        room = max(1, self.slots * _WAITING_PER_SLOT) - len(self.running)
        now_s = time.monotonic()
        for _ in range(min(room, len(self.waiting))):
            unit = self.waiting.popleft()
            self.running[task.remote(sent, unit)] = _Attempt(unit, now_s)
        if self.waiting or not self.recent_s or len(self.running) >= self.slots:
            return
        slow_s = max(_SLOW_S, _SLOW_FACTOR * statistics.median(self.recent_s))
        for attempt in list(self.running.values()):
            if now_s - attempt.since_s > slow_s and attempt.unit not in self.copied:
                self.copied.add(attempt.unit)
                self.running[task.remote(sent, attempt.unit)] = _Attempt(attempt.unit, now_s)

    def _take(self, reference: Any, attempt: _Attempt) -> None:
        """Take a result, or have the unit done again if its worker was lost."""
        unit = attempt.unit
        try:
            digest, taken_s = self.ray.get(reference)
        except self.ray.exceptions.RayTaskError as error:
            _raise_cause(error)
        except self.ray.exceptions.RayError as error:
            self._lost(unit, error)
            return
        self.recent_s.append(taken_s)
        if unit not in self.digests:
            self.digests[unit] = digest
            self.progress.add(self.job.frames_of(unit), taken_s)

    def _lost(self, unit: int, error: Exception) -> None:
        if unit in self.digests or any(a.unit == unit for a in self.running.values()):
            return
        self.losses[unit] += 1
        if self.losses[unit] == _MOST_LOSSES:
            raise JobError(
                f"{self.job.part(unit)}: its worker was lost {_MOST_LOSSES} times"
                f" ({type(error).__name__}), perhaps for lack of memory; finished parts are kept"
            ) from error
        self.progress.say(f"a worker was lost ({type(error).__name__}): its work is done again")
        self.waiting.appendleft(unit)


def work(sent: list[Any], unit: int) -> tuple[str, float]:
    """Do a unit in a process of the cluster.

    Args:
        sent: Reference to the job, what starts a worker, and the version that sent them.
        unit: Number of the unit.

    Returns:
        SHA-256 of the part and the seconds that it took.

    Raises:
        JobError: If this machine has another version of the project.
    """
    import ray

    (reference,) = sent
    job, start, expected = ray.get(reference)
    if version("edgetree") != expected:
        raise JobError(
            f"a machine of the cluster has edgetree {version('edgetree')}: expected {expected}, as"
            " where the command was started"
        )
    key = reference.hex()
    if key not in _workers:
        _workers.clear()
        _workers[key] = start()
    return do_unit(job, _workers[key], unit)


def _raise_cause(error: Any) -> NoReturn:
    """Raise what a task raised: a message for the user, or a bug with its traceback."""
    cause = error.cause
    if isinstance(cause, ModuleNotFoundError):
        raise JobError(
            f"a machine of the cluster cannot start a worker ({cause}): expected the same"
            " installation on all of them"
        ) from error
    if hasattr(cause, "exit_code") or isinstance(cause, OSError):
        raise cause from error
    raise error
