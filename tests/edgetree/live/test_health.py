"""The state of a live service, and whom it is told to."""

from __future__ import annotations

import dataclasses
import time
from typing import Any

import pytest

from basetree.program.supervisor import Supervisor
from edgetree.live.health import ServiceHealth, StateReporter
from edgetree.live.status import LiveStatus, StatusRecorder
from edgetree.results.service_state import STATE_SCHEMA, ServiceState, state_message

RUNNING = LiveStatus("running", 7, 2, {"no depth": 3}, 1, 10.0, {"detect": 40.0}, 55.0, 0.1)


class Told(Supervisor):
    """A supervisor that keeps what it is told."""

    def __init__(self, watchdog_s: float | None = None) -> None:
        super().__init__({})
        self.watchdog_s = watchdog_s
        self.lines: list[str] = []

    def _send(self, line: str) -> None:
        self.lines.append(line)


def health_of(**changes: Any) -> ServiceHealth:
    return ServiceHealth(lambda: dataclasses.replace(RUNNING, **changes), "model.onnx")


@pytest.mark.parametrize(
    ("changes", "name", "reason"),
    [
        ({"state": "starting", "results": 0, "silent_s": 60.0}, "starting", ""),
        ({}, "running", ""),
        ({"state": "lost", "fault": "camera 0 is gone"}, "camera lost", "camera 0 is gone"),
        ({"silent_s": 2.5}, "stale", "no results come"),
        ({"silent_s": 2.5, "slow_frame_s": 2.0}, "running", ""),  # a camera with a frame each 2 s
        ({"silent_s": 12.0, "slow_frame_s": 2.0}, "stale", "no results come"),
        ({"state": "ended"}, "stopping", ""),
    ],
)
def test_the_state_follows_from_the_pipeline(
    changes: dict[str, Any], name: str, reason: str
) -> None:
    state = health_of(**changes).state()
    assert (state.name, state.reason) == (name, reason)


def test_a_state_is_one_object_for_as_long_as_it_lasts() -> None:
    now = [RUNNING]
    health = ServiceHealth(lambda: now[0])
    first = health.state()
    assert health.state() is first
    now[0] = dataclasses.replace(RUNNING, state="lost", fault="gone", results=9)
    lost = health.state()
    assert lost is not first
    assert lost.since_s is not None
    assert first.since_s is not None
    assert lost.since_s >= first.since_s
    record = lost.record()
    assert record["schema"] == STATE_SCHEMA
    assert (record["state"], record["reason"], record["results"]) == ("camera lost", "gone", 9)
    assert record["since"].endswith("Z")


def test_a_state_with_a_long_reason_fits_the_smallest_datagram() -> None:
    message = state_message(ServiceState("camera lost", "x" * 5000, time.time(), 10**9), 10**9)
    assert len(message) < 320


def test_a_frame_in_work_for_too_long_is_a_service_that_hangs() -> None:
    recorder = StatusRecorder()
    health = ServiceHealth(lambda: recorder.status(0, {}))
    recorder.begin("detect")
    time.sleep(0.05)
    assert health.is_working()
    assert not health.is_working(0.01)
    recorder.end("detect")
    time.sleep(0.05)  # a camera that sends nothing is no fault of the process
    assert health.is_working(0.01)


def test_outputs_and_supervisor_hear_of_each_state() -> None:
    now, told, supervisor = [dataclasses.replace(RUNNING, state="starting")], [], Told(0.2)
    health = ServiceHealth(lambda: now[0])
    with StateReporter(health, told.append, supervisor):
        for state, fault in (("running", ""), ("lost", "gone"), ("running", "")):
            now[0] = dataclasses.replace(RUNNING, state=state, fault=fault)
            time.sleep(0.15)
    names = [state.name for state in told]
    assert names == ["starting", "running", "camera lost", "running", "stopping"]
    statuses = [line for line in supervisor.lines if line.startswith("STATUS=")]
    assert statuses == [
        *("STATUS=starting", "STATUS=running", "STATUS=camera lost: gone", "STATUS=running"),
        "STATUS=stopping",
    ]
    assert supervisor.lines.index("READY=1") < supervisor.lines.index("WATCHDOG=1")
    assert "STOPPING=1" in supervisor.lines


def test_a_service_that_ends_by_a_fault_says_why() -> None:
    told: list[ServiceState] = []
    with (
        pytest.raises(ValueError, match="no model"),
        StateReporter(health_of(), told.append, supervisor := Told()),
    ):
        raise ValueError("no model")
    assert (told[-1].name, told[-1].reason) == ("stopping", "no model")
    assert supervisor.lines[-1] == "STATUS=stopping: no model"


def test_the_state_is_repeated_every_second() -> None:
    told: list[ServiceState] = []
    with StateReporter(health_of(), told.append, Told()):
        time.sleep(1.4)
    assert [state.name for state in told] == ["running", "running", "stopping"]
    assert told[0] is told[1]


def test_a_service_that_hangs_does_not_feed_the_watchdog() -> None:
    supervisor = Told(0.2)
    with StateReporter(health_of(busy_s=5.0), lambda state: None, supervisor):
        time.sleep(0.3)
    assert "WATCHDOG=1" not in supervisor.lines


def test_metrics_are_what_prometheus_reads() -> None:
    parser = pytest.importorskip("prometheus_client.parser")
    health = ServiceHealth(lambda: RUNNING, "model.onnx", lambda: {"--csv a.csv": 4})
    families = {
        each.name: each for each in parser.text_string_to_metric_families(health.metrics().decode())
    }
    samples = {
        (sample.name, *sample.labels.values()): sample.value
        for family in families.values()
        for sample in family.samples
    }
    assert samples["edgetree_frames_total",] == 7
    assert samples["edgetree_frames_dropped_total",] == 2
    assert samples["edgetree_frames_left_out_total",] == 3
    assert samples["edgetree_source_lost_total",] == 1
    assert samples["edgetree_state", "running"] == 1
    assert samples["edgetree_state", "camera lost"] == 0
    assert samples["edgetree_stage_seconds", "detect"] == pytest.approx(0.04)
    assert samples["edgetree_age_seconds",] == pytest.approx(0.055)
    assert samples["edgetree_output_missing_total", "--csv a.csv"] == 4
    assert families["edgetree_frames"].type == "counter"
    assert families["edgetree_info"].samples[0].labels["model"] == "model.onnx"
    if "process_resident_memory_bytes" in families:  # Linux alone tells it
        assert samples["process_resident_memory_bytes",] > 1e6
