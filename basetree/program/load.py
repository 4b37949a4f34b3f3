"""Whether the machine is busy with other work, which makes measured times too long."""

from __future__ import annotations

from typing import Final

BUSY_FROM: Final = 0.5
"""Share of the cores from which on other work disturbs a measurement of time."""


def busy_words(busy_cores: float | None, cores: int | None) -> str:
    """That a machine was busy with other work, in words; empty if it was not.

    Args:
        busy_cores: The load of the last minute before the measurement; None if not known.
        cores: The number of cores; None if not known.
    """
    if busy_cores is None or cores is None or busy_cores < BUSY_FROM * cores:
        return ""
    of = f"{busy_cores:.1f} of {cores} cores were busy"
    if busy_cores > cores:
        return f"other work put a load of {busy_cores:.1f} on {cores} cores in the last minute"
    return f"{of} with other work in the last minute"
