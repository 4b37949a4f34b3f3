"""What all outputs of live results have in common."""

from __future__ import annotations

from typing import Protocol

from edgetree.live.results import LiveResult

__all__ = ["Sink"]


class Sink(Protocol):
    """An output of live results. Files appear at their path when the sink is closed."""

    def write(self, result: LiveResult) -> None:
        """Take the result of one frame.

        Raises:
            InputError: a file cannot be written. Errors of the network are logged and counted.
        """

    def close(self) -> None:
        """Complete the output. A second call does nothing.

        Raises:
            InputError: a file cannot be written.
        """
