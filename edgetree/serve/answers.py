"""The texts of the service's answers."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import msgspec

from basetree.program.python import installed_version
from edgetree.serve.faults import Faults
from edgetree.serve.messages import ErrorAnswer, ResultAnswer, StatusAnswer, UnusedAnswer

if TYPE_CHECKING:
    from edgetree.live.status import LiveStatus


def result_text(id_: int | None, record: dict[str, Any]) -> bytes:
    """The answer with a result.

    Args:
        id_: The id that the frame has at the program; None for those that watch.
        record: The result, of the schema edgetree.live/1.
    """
    tag = ResultAnswer.__struct_config__.tag
    answer = {"schema": tag, "id": id_, "result": record}
    return json.dumps(answer, allow_nan=False, separators=(",", ":")).encode()


def answer_text(answer: UnusedAnswer | ErrorAnswer | StatusAnswer) -> bytes:
    """Any other answer."""
    return msgspec.json.encode(answer)


def status_answer(status: LiveStatus | None, faults: Faults) -> StatusAnswer:
    """How the service is, by the state of its pipeline; None if there is none yet."""
    return StatusAnswer(
        version=installed_version("edgetree") or "",
        state="starting" if status is None else status.state,
        results=0 if status is None else status.results,
        silent_s=0.0 if status is None else round(status.silent_s, 3),
        line="starting" if status is None else status.line(),
        faults=dict(faults.counts),
    )
