"""Answers of the page's server to other programs: health, metrics, stems and version."""

from __future__ import annotations

import json
from collections.abc import Callable
from http import HTTPStatus
from typing import Any, Final, NamedTuple

from basetree.errors import MissingPackage
from edgetree.live.health import METRICS_TYPE, ServiceHealth
from edgetree.live.page.feed import Feed

OPEN_PATHS: Final = frozenset({"/healthz", "/readyz"})
"""What is answered without the token: it tells the state and nothing else."""

_NOT_WATCHED: Final = "nothing is watched: give the server a ServiceHealth"


class Answer(NamedTuple):
    """An answer to a request."""

    status: HTTPStatus
    content_type: str
    content: bytes


def service_answer(path: str, feed: Feed) -> Answer | None:
    """The answer for a path; None if it is not one of these."""
    if path == "/stems.json":
        return _stems(feed)
    answer = _ANSWERS.get(path)
    if answer is None:
        return None
    if feed.health is None:
        return _json(HTTPStatus.NOT_IMPLEMENTED, {"fault": _NOT_WATCHED})
    return answer(feed.health)


def _healthz(health: ServiceHealth) -> Answer:
    """Whether the service works: a lost camera is no fault of it."""
    works = health.is_working()
    fault = {} if works else {"fault": "a frame has been in work for too long"}
    status = HTTPStatus.OK if works else HTTPStatus.SERVICE_UNAVAILABLE
    return _json(status, {**health.state().record(), **fault})


def _readyz(health: ServiceHealth) -> Answer:
    """Whether results come."""
    state = health.state()
    is_ready = state.name == "running"
    return _json(HTTPStatus.OK if is_ready else HTTPStatus.SERVICE_UNAVAILABLE, state.record())


def _metrics(health: ServiceHealth) -> Answer:
    try:
        return Answer(HTTPStatus.OK, METRICS_TYPE, health.metrics())
    except MissingPackage as error:
        return _json(HTTPStatus.NOT_IMPLEMENTED, {"fault": str(error)})


def _version(health: ServiceHealth) -> Answer:
    return _json(HTTPStatus.OK, health.about)


def _stems(feed: Feed) -> Answer:
    """The newest stems; none of them where they are old."""
    newest = feed.newest
    if newest is None or feed.is_stale(newest):
        return _json(HTTPStatus.SERVICE_UNAVAILABLE, feed.status())
    return _json(HTTPStatus.OK, {**newest.record(), **feed.status()})


def _json(status: HTTPStatus, record: dict[str, Any]) -> Answer:
    return Answer(status, "application/json", json.dumps(record, allow_nan=False).encode())


_ANSWERS: Final[dict[str, Callable[[ServiceHealth], Answer]]] = {
    "/healthz": _healthz,
    "/readyz": _readyz,
    "/metrics": _metrics,
    "/version": _version,
}
