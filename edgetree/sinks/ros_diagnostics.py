"""The state of a live pipeline as diagnostics of ROS 2 (diagnostic_msgs)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from edgetree.sinks.ros_types import MakeMessage, RosTypes
from edgetree.sources.source import REMARKS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from edgetree.live.status import LiveStatus

_OK, _WARN, _ERROR, _STALE = range(4)
_LEVELS: Final = {"starting": _WARN, "running": _OK, "lost": _ERROR, "ended": _STALE}


class RosDiagnostics(RosTypes):
    """Makes the messages.

    Args:
        name: What they are about, such as "edgetree: trees".
        stale_s: A pipeline without a result for longer is stale, s.
        make: Makes one message, as for `RosTypes`.
    """

    def __init__(self, name: str, stale_s: float, make: MakeMessage | None = None) -> None:
        super().__init__(make)
        self._name, self._stale_s = name, stale_s
        self._left_out = 0

    def of_status(self, status: LiveStatus, counts: Mapping[str, int], time_s: float) -> Any:
        """A DiagnosticArray.

        The level is OK while results come, WARN before the first and if frames were left out since
        the message before, STALE if no result comes any more, and ERROR if the source is lost.

        Args:
            status: The state of the pipeline.
            counts: What was left out or noticed before the pipeline, by reason.
            time_s: Now, s.
        """
        remarks = {key: count for key, count in counts.items() if key in REMARKS}
        left_out = {key: count for key, count in counts.items() if key not in REMARKS}
        left_out |= status.left_out
        level = _LEVELS[status.state]
        if level == _OK and status.silent_s > self._stale_s:
            level = _STALE
        if level == _OK and sum(left_out.values()) > self._left_out:
            level = _WARN
        self._left_out = sum(left_out.values())
        values = {
            "state": status.state,
            "results": status.results,
            "results per second": f"{status.rate_hz:.1f}",
            "age of a result, ms": f"{status.age_ms:.0f}",
            "time since the last result, s": f"{status.silent_s:.1f}",
            "replaced by newer frames": status.dropped,
            **{f"left out: {reason}": count for reason, count in left_out.items()},
            **remarks,
            **status.remarks,
        }
        pairs = [self.new("diagnostic_msgs", "KeyValue", key, str(v)) for key, v in values.items()]
        told = self.new("diagnostic_msgs", "DiagnosticStatus", level, *self._words(status), pairs)
        return self.new("diagnostic_msgs", "DiagnosticArray", self.header(time_s, ""), [told])

    def _words(self, status: LiveStatus) -> tuple[str, str, str]:
        """Name, message and hardware."""
        return self._name, status.line(), ""
