"""What a service that follows trees says of itself, for controllers and supervisors."""

from __future__ import annotations

import json
import threading
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final, Literal, TypeAlias

STATE_SCHEMA: Final = "edgetree.live.state/1"

StateName: TypeAlias = Literal["starting", "running", "camera lost", "stale", "stopping", "gone"]

_LONGEST_REASON: Final = 120


@dataclass(frozen=True)
class ServiceState:
    """The state of a service.

    Attributes:
        name: "starting" before the first result; "running"; "camera lost" while the source does not
            answer; "stale" while no results come although the source is there; "stopping" at the
            end. "gone" is what an MQTT broker says of a service that vanished.
        reason: Why, in words; empty for "running".
        since_s: When it began, s since 1970; None if nobody knows.
        results: Frames that had a result by then.
    """

    name: StateName
    reason: str = ""
    since_s: float | None = None
    results: int = 0

    def line(self) -> str:
        """The state as a line of text."""
        return f"{self.name}: {self.reason}" if self.reason else self.name

    def record(self) -> dict[str, Any]:
        """The state as a JSON object of the schema `STATE_SCHEMA`."""
        since = None
        if self.since_s is not None:
            moment = datetime.fromtimestamp(self.since_s, UTC)
            since = moment.isoformat(timespec="milliseconds").replace("+00:00", "Z")
        return {
            "schema": STATE_SCHEMA,
            "state": self.name,
            "reason": self.reason[:_LONGEST_REASON],
            "since": since,
            "results": self.results,
        }


class StateChanges:
    """Notices when a state begins. Thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now = ServiceState("starting", "", time.time())

    def update(self, name: StateName, reason: str, results: int) -> ServiceState:
        """The state now: the same object as before if it is the same state."""
        with self._lock:
            if (name, reason) != (self._now.name, self._now.reason):
                self._now = ServiceState(name, reason, time.time(), results)
            return self._now


def state_message(state: ServiceState, sequence: int | None = None) -> bytes:
    """The state as a short JSON text, with the number of the message if there is one."""
    numbered = {} if sequence is None else {"sequence": sequence}
    return json.dumps({**state.record(), **numbered}, separators=(",", ":")).encode()
