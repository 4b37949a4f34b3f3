"""The page among clients that are slow, many, or send what they should not."""

from __future__ import annotations

import logging
import socket
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest

_TOKEN = "0123456789abcdef"


@pytest.fixture
def strangers() -> Iterator[list[socket.socket]]:
    """Sockets that are closed at the end."""
    opened: list[socket.socket] = []
    yield opened
    for each in opened:
        each.close()


def _port(server) -> int:
    return int(server.address.split(":")[2].split("/")[0])


def test_the_owner_is_served_beside_200_slow_strangers(
    serve, connect, strangers, live_result
) -> None:
    server = serve(token=_TOKEN, stale_s=60)
    server.publish(live_result())
    for number in range(200):
        stranger = socket.create_connection(("127.0.0.1", _port(server)), timeout=10)
        with suppress(OSError):  # it may have been ended already
            stranger.sendall(b"GET /events HTTP/1.1\r\nHost: 127.0.0.1\r\n"[: number % 40])
        strangers.append(stranger)
    assert connect(server).send(f"/?token={_TOKEN}").status() == 200
    events = connect(server).send(f"/events?token={_TOKEN}")
    assert events.status() == 200
    for _ in range(100):  # while more of them come
        stranger = socket.create_connection(("127.0.0.1", _port(server)), timeout=10)
        strangers.append(stranger)
    assert events.event()[0] in ("stems", "beat")
    assert events.event()[0] in ("stems", "beat")
    assert connect(server).send(f"/picture.jpg?token={_TOKEN}").status() == 200


def test_the_oldest_stranger_makes_room(serve, connect, strangers) -> None:
    server = serve(token=_TOKEN, stale_s=60)
    first = connect(server)
    first.socket.sendall(b"GET")
    for _ in range(60):
        strangers.append(socket.create_connection(("127.0.0.1", _port(server)), timeout=10))
    with suppress(ConnectionResetError):
        assert first.rest() == b""


def test_one_owner_may_open_many_connections_but_not_any_number(
    serve, connect, live_result
) -> None:
    server = serve(max_clients=1, stale_s=60)
    server.publish(live_result())
    for _ in range(12):
        assert connect(server).send("/picture.jpg").status() == 200
    late = connect(server).send("/picture.jpg")
    assert late.status() == 503
    assert b"too many pages are open, 1 are allowed" in late.rest()


def _logged(caplog: pytest.LogCaptureFixture, count: int) -> str:
    end_s = time.monotonic() + 10
    while len(caplog.records) < count and time.monotonic() < end_s:
        time.sleep(0.02)
    return caplog.text


@pytest.mark.parametrize(
    "line",
    [
        f"GET /?token={_TOKEN} HTTP/1.1",
        f"GET /?token={_TOKEN} HTTP/x",
        f"GET /?a=1&token={_TOKEN} HTTP/1.1 more",
        f"BREW /?token={_TOKEN} HTTP/1.1",
        f"POST /?token={_TOKEN} HTTP/1.1",
    ],
)
def test_the_token_is_in_no_log(
    serve, connect, caplog: pytest.LogCaptureFixture, line: str
) -> None:
    caplog.set_level(logging.DEBUG)
    client = connect(serve(token=_TOKEN))
    before = len(caplog.records)
    client.socket.sendall(f"{line}\r\nHost: 127.0.0.1\r\n\r\n".encode())
    client.rest()
    text = _logged(caplog, before + 1)
    assert len(caplog.records) > before
    assert _TOKEN not in text


def test_what_a_client_writes_stays_on_one_line_of_the_log(
    serve, connect, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.DEBUG)
    client = connect(serve())
    client.socket.sendall(b"GET /\x1b[2J\x0bforged HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
    client.rest()
    _logged(caplog, 2)
    assert "forged" in caplog.text
    assert all(record.getMessage().isprintable() for record in caplog.records)


@pytest.mark.parametrize(
    "field",
    [
        "Content-Length: 60",
        "content-length : 60",
        "Transfer-Encoding: chunked",
        "Content-Length: 0\r\nContent-Length: 60",
        "Content-Length: -1",
        "Content-Length: +60",
        " Content-Length: 60",
    ],
)
@pytest.mark.parametrize("late", [False, True])
def test_a_body_is_never_read_as_a_request(
    serve, connect, live_result, field: str, late: bool
) -> None:
    server = serve(stale_s=60)
    server.publish(live_result())
    client = connect(server)
    head = f"GET /picture.jpg HTTP/1.1\r\nHost: 127.0.0.1\r\n{field}\r\n\r\n"
    body = "GET /other HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    client.socket.sendall(head.encode())
    with suppress(OSError):  # it may be over already
        if late:
            time.sleep(0.05)
        client.socket.sendall(body.encode())
    answers = b""
    with suppress(ConnectionResetError):
        answers = client.rest()
    assert answers.count(b"HTTP/1.1 ") <= 1
    assert b"404" not in answers


def test_a_second_request_in_the_same_packet_ends_the_connection(
    serve, connect, live_result
) -> None:
    server = serve(stale_s=60)
    server.publish(live_result())
    client = connect(server)
    one = b"GET /picture.jpg HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n"
    client.socket.sendall(one + one)
    answer = client.rest()
    assert answer.count(b"HTTP/1.1 200") == 1
