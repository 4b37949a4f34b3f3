"""Interrupts at every place where Python can raise them."""

from __future__ import annotations

import dis
import signal
import sys
from collections.abc import Callable
from functools import cache
from types import CodeType, FrameType
from typing import Any

# After these Python looks whether a signal came.
_LOOKS = ("CALL", "RESUME", "JUMP_BACKWARD")


def interrupted_at(place: int, run: Callable[[], object], *modules: str) -> bool:
    """Run a function and interrupt it, as Ctrl-C would, at one of the places where that can happen.

    Args:
        place: Number of the place, from 0 on, in the order in which they are reached.
        run: The function.
        modules: Names of the modules whose code is meant, such as threading.

    Returns:
        Whether there was such a place.
    """
    left, is_done = place, False
    before: dict[int, str] = {}

    def trace(frame: FrameType, event: str, _: Any) -> Any:
        nonlocal left, is_done
        if frame.f_globals.get("__name__") not in modules:
            return None
        frame.f_trace_opcodes = True
        if event != "opcode" or is_done:
            return trace
        looked = before.get(id(frame), "").startswith(_LOOKS)
        before[id(frame)] = _names(frame.f_code).get(frame.f_lasti, "")
        left -= looked
        if looked and left < 0:
            is_done = True
            handler = signal.getsignal(signal.SIGINT)
            assert callable(handler)
            handler(signal.SIGINT, frame)
        return trace

    sys.settrace(trace)
    try:
        run()
    except KeyboardInterrupt:
        assert is_done
    finally:
        sys.settrace(None)
    return is_done


@cache
def _names(code: CodeType) -> dict[int, str]:
    return {each.offset: each.opname for each in dis.get_instructions(code)}
