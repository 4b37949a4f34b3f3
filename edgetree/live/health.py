"""How a live service goes: its state, whether it works, and its counts for Prometheus."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from importlib.metadata import version
from types import TracebackType
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import MissingPackage, install_hint
from basetree.program.interrupts import interrupt_afterwards
from basetree.program.supervisor import Supervisor
from edgetree.live.status import STALE_FRAMES, STALE_S, LiveStatus
from edgetree.results.service_state import ServiceState, StateChanges, StateName

if TYPE_CHECKING:
    from collections.abc import Iterator

_HUNG_S: Final = 30.0  # no model takes as long for one frame
_TICK_S: Final = 0.25
_REPEAT_S: Final = 1.0
_STATES: Final[tuple[StateName, ...]] = ("starting", "running", "camera lost", "stale", "stopping")
METRICS_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"


class ServiceHealth:
    """What a service says of itself. All methods may be called from any thread.

    Args:
        status: Returns the state of the pipeline.
        model: Name of the model file.
        missing: Returns how many results each output lacks, by its name.
    """

    def __init__(
        self,
        status: Callable[[], LiveStatus],
        model: str = "",
        missing: Callable[[], Mapping[str, int]] = dict,
    ) -> None:
        self._status, self._missing = status, missing
        self._changes = StateChanges()
        self._stopping: str | None = None
        self.about = {"name": "edgetree", "version": version("edgetree"), "model": model}

    def stop(self, reason: str = "") -> None:
        """From now on the service is stopping, for a reason if it has a fault."""
        self._stopping = reason

    def state(self) -> ServiceState:
        """The state now."""
        status = self._status()
        return self._changes.update(*self._named(status), status.results)

    def is_working(self, limit_s: float = _HUNG_S) -> bool:
        """Whether no frame has been in work for longer than a limit, s.

        A camera that sends nothing is no fault of this process, so that it counts as working.
        """
        return self._status().busy_s <= limit_s

    def metrics(self) -> bytes:
        """The counts in Prometheus' text form.

        Raises:
            MissingPackage: Prometheus-client is not installed.
        """
        try:
            from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
        except ImportError as error:
            raise MissingPackage(
                f"metrics need the package prometheus-client: {install_hint('metrics')}"
            ) from error
        registry = CollectorRegistry()
        registry.register(self)
        ProcessCollector(registry=registry)
        return bytes(generate_latest(registry))

    def collect(self) -> Iterator[Any]:
        """The metrics, as collectors of prometheus-client give them."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        status, now = self._status(), self.state()
        info = GaugeMetricFamily("edgetree_info", "Version and model.", labels=list(self.about))
        info.add_metric(list(self.about.values()), 1.0)
        states = GaugeMetricFamily("edgetree_state", "1 for the state now.", labels=["state"])
        for state in _STATES:
            states.add_metric([state], float(state == now.name))
        stages = GaugeMetricFamily(
            "edgetree_stage_seconds", "Median time of a stage, of 50 frames.", labels=["stage"]
        )
        for name, value_ms in status.stages_ms.items():
            stages.add_metric([name], value_ms / 1000)
        missing = CounterMetricFamily(
            "edgetree_output_missing", "Results that an output lacks.", labels=["output"]
        )
        for name, count in self._missing().items():
            missing.add_metric([name], count)
        yield from (info, states, stages, missing)
        for name, words, count in (
            ("frames", "Frames with a result.", status.results),
            ("frames_dropped", "Frames left out for newer ones.", status.dropped),
            ("frames_left_out", "Frames that could not be used.", sum(status.left_out.values())),
            ("source_lost", "How many times the source was lost.", status.lost),
        ):
            yield CounterMetricFamily(f"edgetree_{name}", words, value=count)
        for name, words, value in (
            ("frames_per_second", "Results per second, of 50 frames.", status.rate_hz),
            ("age_seconds", "Median age of a result, of 50 frames.", status.age_ms / 1000),
            ("silent_seconds", "Time since the last result.", status.silent_s),
        ):
            yield GaugeMetricFamily(f"edgetree_{name}", words, value=value)

    def _named(self, status: LiveStatus) -> tuple[StateName, str]:
        if self._stopping is not None or status.state == "ended":
            return "stopping", self._stopping or ""
        if status.state == "lost":
            return "camera lost", status.fault
        if status.state == "starting":
            return "starting", ""
        if status.silent_s > max(STALE_S, STALE_FRAMES * status.slow_frame_s):
            return "stale", "no results come"
        return "running", ""


class StateReporter:
    """Tells outputs and the supervisor the state of a service, during a block.

    Args:
        health: The service.
        tell: Takes the state, at each change and every second.
        supervisor: The supervisor of the process.
    """

    def __init__(
        self,
        health: ServiceHealth,
        tell: Callable[[ServiceState], None],
        supervisor: Supervisor | None = None,
    ) -> None:
        self._health, self._tell = health, tell
        self._supervisor = supervisor or Supervisor()
        self._ending = threading.Event()
        self._told: ServiceState | None = None
        self._told_s = 0.0
        self._thread = threading.Thread(target=self._run, name="edgetree-state", daemon=True)

    def __enter__(self) -> StateReporter:
        with interrupt_afterwards():
            self._look()
            self._supervisor.ready()
            self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with interrupt_afterwards():
            self._health.stop("" if error is None else str(error))
            self._supervisor.stopping()
            self._ending.set()
            self._thread.join()
            self._look()

    def _run(self) -> None:
        limit_s = self._supervisor.watchdog_s
        every_s = _TICK_S if limit_s is None else min(_TICK_S, limit_s / 4)
        while not self._ending.wait(every_s):
            self._look()
            if limit_s is not None and self._health.is_working(limit_s):
                self._supervisor.alive()

    def _look(self) -> None:
        state, now_s = self._health.state(), time.monotonic()
        if state is self._told and now_s - self._told_s < _REPEAT_S:
            return
        if state is not self._told:
            self._supervisor.status(state.line())
        self._told, self._told_s = state, now_s
        self._tell(state)
