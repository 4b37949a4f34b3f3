"""Marks from the page and from controllers: who may, and what comes of it."""

from __future__ import annotations

import json

import pytest

TOKEN = "correct-horse-battery"
HERE = "127.0.0.1:8420"


def test_a_mark_reaches_the_recorder_and_is_confirmed(serve, connect, recorder) -> None:
    client = connect(serve(recorder=recorder)).post("/mark", body="wrong\n diameter")
    assert client.status() == 200
    assert json.loads(client.rest().rpartition(b"\r\n\r\n")[2]) == {"kept_s": 5.0}
    assert recorder.texts == ["wrong diameter"]


def test_a_body_may_come_late_and_in_other_letters(serve, connect, recorder) -> None:
    client = connect(serve(recorder=recorder))
    body = "läpimitta väärin".encode()
    head = f"POST /mark HTTP/1.1\r\nHost: localhost\r\nContent-Length: {len(body)}\r\n\r\n"
    client.socket.sendall(head.encode())
    client.socket.sendall(body[:3])
    client.socket.sendall(body[3:])
    assert client.status() == 200
    assert recorder.texts == ["läpimitta väärin"]


def test_without_a_body_the_mark_has_no_text(serve, connect, recorder) -> None:
    client = connect(serve(recorder=recorder))
    client.socket.sendall(b"POST /mark HTTP/1.1\r\nHost: localhost\r\n\r\n")
    assert client.status() == 200
    assert recorder.texts == [""]


@pytest.mark.parametrize(
    ("path", "headers", "status"),
    [
        ("/mark", (), 403),
        ("/mark?token=wrong", (), 403),
        (f"/mark?token={TOKEN}", (), 200),
        (f"/mark?token={TOKEN}", (f"Origin: http://{HERE}", "Sec-Fetch-Site: same-origin"), 200),
        (f"/mark?token={TOKEN}", ("Origin: http://evil.example",), 403),
        (f"/mark?token={TOKEN}", (f"Origin: http://{HERE}.evil.example",), 403),
        (f"/mark?token={TOKEN}", ("Origin: http://127.0.0.1:9999",), 403),
        (f"/mark?token={TOKEN}", ("Origin: null",), 403),
        (f"/mark?token={TOKEN}", ("Sec-Fetch-Site: cross-site",), 403),
        (f"/mark?token={TOKEN}", ("Sec-Fetch-Site: same-site",), 403),
        (f"/events?token={TOKEN}", (), 405),
    ],
)
def test_only_who_may_see_the_page_may_mark_and_no_other_site(
    serve, connect, recorder, path: str, headers: tuple[str, ...], status: int
) -> None:
    client = connect(serve(token=TOKEN, recorder=recorder)).post(path, *headers, host=HERE)
    assert client.status() == status
    assert len(recorder.texts) == (status == 200)


def test_a_foreign_name_is_refused(serve, connect, recorder) -> None:
    client = connect(serve(recorder=recorder)).post("/mark", host="evil.example")
    assert client.status() == 421
    assert recorder.texts == []


@pytest.mark.parametrize(
    ("lines", "status"),
    [
        ("Content-Length: 1001\r\n", 413),
        ("Content-Length: -1\r\n", 400),
        ("Content-Length: 2\r\nContent-Length: 3\r\n", 411),
        ("Transfer-Encoding: chunked\r\n", 411),
    ],
)
def test_other_bodies_are_refused(serve, connect, recorder, lines: str, status: int) -> None:
    client = connect(serve(recorder=recorder))
    client.socket.sendall(f"POST /mark HTTP/1.1\r\nHost: localhost\r\n{lines}\r\n".encode())
    assert client.status() == status
    assert recorder.texts == []


def test_without_a_recorder_the_page_says_so(serve, connect) -> None:
    server = serve()
    client = connect(server).post("/mark")
    assert client.status() == 409
    assert b"start edgetree with --record" in client.rest()
    assert connect(server).send("/events").event()[1]["recordings"] is None


def test_the_events_say_how_many_recordings_there_are(serve, connect, recorder) -> None:
    event = connect(serve(recorder=recorder)).send("/events").event()[1]
    assert event["recordings"] == {
        "written": 2,
        "failed": 0,
        "left_out": 0,
        "is_recording": False,
    }


def test_what_a_terminal_would_obey_is_left_out(serve, connect, recorder) -> None:
    connect(serve(recorder=recorder)).post("/mark", body="a\x1b[2J\x07 b").status()
    assert recorder.texts == ["a [2J b"]
