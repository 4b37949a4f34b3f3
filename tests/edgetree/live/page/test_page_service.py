"""What the page's server answers to other programs, also among faults."""

from __future__ import annotations

import json
import logging
import socket
import sys
import time
from contextlib import suppress

import pytest

from basetree.errors import Unavailable
from edgetree.live.health import ServiceHealth
from edgetree.live.page import PageServer, server
from edgetree.live.status import LiveStatus

_TOKEN = "0123456789abcdef"


class Pipeline:
    """Has the status of a pipeline."""

    def __init__(self) -> None:
        self.status = LiveStatus("running", 7, 0, {}, 0, 10.0, {}, 55.0, 0.1)

    def set(self, **changes) -> None:
        from dataclasses import replace

        self.status = replace(self.status, **changes)


@pytest.fixture
def pipeline() -> Pipeline:
    return Pipeline()


@pytest.fixture
def health(pipeline: Pipeline) -> ServiceHealth:
    return ServiceHealth(lambda: pipeline.status, "model.onnx")


def answer(client) -> tuple[int, dict]:
    status = client.status()
    client.until(b"\r\n\r\n")
    return status, json.loads(client.rest())


def test_health_and_readiness_are_two_things(serve, connect, pipeline, health) -> None:
    page = serve(health=health)

    def asked(path: str) -> tuple[int, str]:
        status, record = answer(connect(page).send(path))
        return status, record["state"]

    assert asked("/healthz") == (200, "running")
    assert asked("/readyz") == (200, "running")
    pipeline.set(state="lost", fault="camera 0 is gone")
    assert asked("/healthz") == (200, "camera lost")
    assert asked("/readyz") == (503, "camera lost")
    pipeline.set(state="running", silent_s=60.0)
    assert asked("/readyz") == (503, "stale")
    pipeline.set(state="starting", results=0)
    assert asked("/readyz") == (503, "starting")
    pipeline.set(busy_s=100.0)
    status, record = answer(connect(page).send("/healthz"))
    assert (status, record["fault"]) == (503, "a frame has been in work for too long")


def test_the_version_is_told(serve, connect, health) -> None:
    status, record = answer(connect(serve(health=health)).send("/version"))
    assert (status, record["name"], record["model"]) == (200, "edgetree", "model.onnx")
    assert record["version"][0].isdigit()


def test_the_newest_stems_are_told_and_old_ones_are_not(serve, connect, live_result) -> None:
    page = serve(stale_s=0.3)
    status, record = answer(connect(page).send("/stems.json"))
    assert (status, record["state"]) == (503, "waiting")
    page.publish(live_result(7, stems=4))
    status, record = answer(connect(page).send("/stems.json"))
    assert (status, record["state"], record["frame"], len(record["stems"])) == (200, "live", 7, 4)
    time.sleep(0.4)
    status, record = answer(connect(page).send("/stems.json"))
    assert (status, record["state"], "stems" in record) == (503, "stale", False)


def test_metrics_can_be_scraped(serve, connect, health) -> None:
    parser = pytest.importorskip("prometheus_client.parser")
    client = connect(serve(health=health)).send("/metrics")
    assert client.status() == 200
    assert b"Content-Type: text/plain; version=0.0.4" in client.until(b"\r\n\r\n")
    names = {each.name for each in parser.text_string_to_metric_families(client.rest().decode())}
    assert {"edgetree_frames", "edgetree_state", "edgetree_info"} <= names


def test_without_the_package_metrics_name_the_extra(
    serve, connect, health, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "prometheus_client", None)
    status, record = answer(connect(serve(health=health)).send("/metrics"))
    assert status == 501
    assert "[metrics]" in record["fault"]


def test_a_server_that_watches_nothing_says_so(serve, connect) -> None:
    status, record = answer(connect(serve()).send("/healthz"))
    assert (status, "ServiceHealth" in record["fault"]) == (501, True)


def test_only_the_state_is_told_without_the_token(serve, connect, health) -> None:
    page = serve(health=health, token=_TOKEN)
    assert connect(page).send("/healthz").status() == 200
    assert connect(page).send("/readyz").status() == 200
    for path in ("/metrics", "/stems.json", "/version"):
        assert connect(page).send(path).status() == 403
    assert connect(page).send("/version", f"Authorization: Bearer {_TOKEN}").status() == 200
    assert connect(page).send("/version", f"Authorization: Bearer {_TOKEN}x").status() == 403
    assert connect(page).send("/version", f"Authorization: Basic {_TOKEN}").status() == 403
    assert connect(page).send("/healthz", host="evil.example").status() == 421


def test_health_is_told_among_a_thousand_connections(serve, connect, health) -> None:
    page = serve(health=health, token=_TOKEN)
    port, strangers = int(page.address.split(":")[2].split("/")[0]), []
    try:
        for number in range(1000):
            stranger = socket.create_connection(("127.0.0.1", port), timeout=10)
            strangers.append(stranger)
            if number % 3 == 0:
                with suppress(OSError):
                    stranger.sendall(b"GET /events HTTP/1.1\r\n")
            if number % 250 == 0:
                assert connect(page).send("/healthz").status() == 200
        started_s = time.monotonic()
        assert connect(page).send("/healthz").status() == 200
        assert time.monotonic() - started_s < 2
    finally:
        for stranger in strangers:
            stranger.close()


def test_a_port_that_is_taken_is_waited_for(
    connect, health, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(server, "_AGAIN_S", 0.05)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(Unavailable, match=f"port {port} .*: expected an address"):
            PageServer(port=port).start()
        page, told = PageServer(port=port, health=health), []
        with caplog.at_level(logging.WARNING):
            page.start(waits=True, on_served=told.append)
        assert "it is tried again every" in caplog.text
        assert page.address == ""
    end_s = time.monotonic() + 10
    while not page.address and time.monotonic() < end_s:
        time.sleep(0.02)
    try:
        assert connect(page).send("/healthz").status() == 200
    finally:
        page.close()
    assert told == [page.address]


def test_a_server_that_still_waits_can_be_closed() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        page = PageServer(port=other.getsockname()[1])
        page.start(waits=True)
        started_s = time.monotonic()
        page.close()
        assert time.monotonic() - started_s < 1
