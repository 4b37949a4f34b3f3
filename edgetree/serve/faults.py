"""What other programs do wrong: counted, and told in one line each, but not without end."""

from __future__ import annotations

import logging
import time
from collections import Counter
from typing import Final

from basetree.errors import one_line

_LOGGER: Final = logging.getLogger(__name__)
_AGAIN_S: Final = 10.0


class Faults:
    """Counts faults by kind. Logs the first of each kind, and then one every 10 s at most.

    Attributes:
        counts: How many there were of each kind.
    """

    def __init__(self) -> None:
        self.counts = Counter[str]()
        self._told_s: dict[str, float] = {}

    def note(self, kind: str, text: str) -> None:
        """Count a fault.

        Args:
            kind: One of a few kinds, such as "message that cannot be read".
            text: What was found and what was expected.
        """
        self.counts[kind] += 1
        now_s = time.monotonic()
        if now_s - self._told_s.get(kind, -_AGAIN_S) < _AGAIN_S:
            return
        self._told_s[kind] = now_s
        _LOGGER.warning("%s, number %d: %s", kind, self.counts[kind], one_line(text))
