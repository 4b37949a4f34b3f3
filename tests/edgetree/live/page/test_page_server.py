"""The page's server: what it shows, what it blanks, and that no client slows the publisher."""

import base64
import hashlib
import re
import socket
import socketserver
import threading
import time
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from basetree.errors import InputError
from edgetree.live.page import PAGE_SCHEMA, PageServer, feed, handler, reading

Serve = Callable[..., PageServer]


def test_the_page_is_one_file_that_loads_nothing_from_elsewhere(serve, connect) -> None:
    client = connect(serve()).send("/")
    assert client.status() == 200
    head, text = client.until(b"\r\n\r\n").decode(), client.rest().decode()
    assert "not a safety function" in text
    assert re.findall(r"(?:src|href)=\"(?!data:)", text) == []
    assert "://" not in text
    policy = re.search("Content-Security-Policy: (.*)\r\n", head)[1]
    assert policy.startswith("default-src 'none'; ")
    assert "connect-src 'self'" in policy
    for tag in ("style", "script"):
        content = re.search(f"<{tag}>(.*)</{tag}>", text, re.DOTALL)[1]
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{tag}-src 'sha256-{digest}'" in policy
    for line in ("X-Content-Type-Options: nosniff", "Cache-Control: no-store", "Server: edgetree"):
        assert f"{line}\r\n" in head


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        ("GET /other HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
        ("GET /../events HTTP/1.1\r\nHost: localhost\r\n\r\n", 404),
        ("POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 3\r\n\r\nabc", 405),
        ("GET / HTTP/1.1\r\n\r\n", 400),
        ("GET /\r\nHost: localhost\r\n\r\n", 505),
        ("nonsense\r\n\r\n", 400),
        ("GET / HTTP/1.1\r\nHost: localhost\r\nX: " + "y" * 20_000 + "\r\n\r\n", 431),
    ],
)
def test_other_requests_are_refused(serve, connect, request_text: str, status: int) -> None:
    client = connect(serve())
    client.socket.sendall(request_text.encode())
    answer = client.rest().decode()
    assert f"{status} " in answer
    assert "Traceback" not in answer


def test_a_published_result_reaches_events_and_picture(serve, connect, live_result) -> None:
    server = serve()
    events, pictures = connect(server).send("/events"), connect(server).send("/picture.mjpeg")
    assert events.event()[1]["state"] == "waiting"
    server.publish(live_result(7, stems=4))
    name, record = events.event()
    assert (name, record["schema"], record["state"]) == ("stems", PAGE_SCHEMA, "live")
    assert (record["frame"], len(record["stems"]), record["dropped"]) == (7, 4, 2)
    fields, jpeg = pictures.picture()
    assert fields["X-Serial"] == str(record["serial"])
    shown = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert shown.shape == (360, 640, 3)
    age_s = record["clock_s"] - float(fields["X-Taken-S"])
    assert 0.05 <= age_s < 2


def test_one_connection_fetches_picture_after_picture(serve, connect, live_result) -> None:
    server = serve(stale_s=0.3)
    client = connect(server)
    for number in (1, 2):
        server.publish(live_result(number))
        assert client.send(f"/picture.jpg?after={number - 1}").status() == 200
        head = client.until(b"\r\n\r\n").decode()
        assert f"X-Serial: {number}\r\n" in head
        assert "Connection: close" not in head
        jpeg = client.exactly(int(re.search(r"Content-Length: (\d+)", head)[1]))
        assert cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR) is not None
    assert client.send("/picture.jpg?after=2").status() == 204  # nothing newer
    client.until(b"\r\n\r\n")
    assert client.send("/picture.jpg").status() == 204  # too old by now


def test_a_given_picture_is_shown_as_it_is(serve, connect, live_result) -> None:
    server = serve()
    picture = np.zeros((1000, 2000, 3), np.uint8)
    picture[:, 1000:] = 250
    server.publish(live_result(), picture)
    shown = cv2.imdecode(
        np.frombuffer(connect(server).send("/picture.mjpeg").picture()[1], np.uint8), 1
    )
    assert shown.shape == (640, 1280, 3)
    assert shown[300, 200].max() < 5
    assert shown[300, 1000].min() > 245


def test_a_picture_is_encoded_once_and_only_if_a_client_watches(
    serve, connect, live_result, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded = []
    original = feed.encode_jpeg
    monkeypatch.setattr(feed, "encode_jpeg", lambda p: encoded.append(1) or original(p))
    server = serve()
    connect(server).send("/events").event()
    server.publish(live_result(1))
    time.sleep(0.2)
    assert encoded == []
    clients = [connect(server).send("/picture.mjpeg") for _ in range(3)]
    assert len({client.picture()[1] for client in clients}) == 1
    assert encoded == [1]


def test_one_thread_draws_for_all_clients(
    serve, connect, live_result, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The C library keeps some MiB for each thread that has drawn a picture."""
    drew = []
    original = feed.draw_result
    monkeypatch.setattr(
        feed, "draw_result", lambda r: drew.append(threading.current_thread().name) or original(r)
    )
    server = serve()
    clients = [connect(server) for _ in range(4)]
    for number, client in enumerate(clients):
        server.publish(live_result(number))
        assert client.send(f"/picture.jpg?after={number}").status() == 200
    assert len(drew) == 4
    assert set(drew) == {"page-drawing_0"}


def test_closing_while_a_picture_is_drawn_ends_the_clients_quietly(
    serve, connect, live_result, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    begun, goes_on = threading.Event(), threading.Event()
    original = feed.draw_result

    def draw(result):
        begun.set()
        assert goes_on.wait(20)
        return original(result)

    monkeypatch.setattr(feed, "draw_result", draw)
    server = serve()
    server.publish(live_result(0))
    first = connect(server).send("/picture.jpg")
    assert begun.wait(20)
    server.publish(live_result(1))
    second = connect(server).send("/picture.jpg?after=1")
    time.sleep(0.2)  # it waits for the thread that draws
    closing = threading.Thread(target=server.close)
    closing.start()
    assert second.rest() == b""
    goes_on.set()
    first.rest()
    closing.join(20)
    assert not closing.is_alive()
    assert caplog.messages == []


def test_a_source_that_stalls_is_told_and_its_picture_blanked(serve, connect, live_result) -> None:
    server = serve(stale_s=0.3)
    events, pictures = connect(server).send("/events"), connect(server).send("/picture.mjpeg")
    server.publish(live_result(1))
    states = [events.event()[1]["state"] for _ in range(6)]
    assert "live" in states
    assert states[-1] == "stale"
    fields = [pictures.picture()[0] for _ in range(3)]
    assert [one.get("X-Serial") for one in fields if "X-Serial" in one] in ([], ["1"])
    assert "X-Serial" not in fields[-1]
    server.publish(live_result(2))
    while events.event()[1]["state"] != "live":
        pass


def test_a_result_that_is_old_when_it_comes_is_stale(serve, connect, live_result) -> None:
    server = serve(stale_s=1.0)
    server.publish(live_result(age_s=3.0))
    assert connect(server).send("/events").event()[1]["state"] == "stale"


def test_a_heartbeat_comes_while_nothing_is_published(serve, connect) -> None:
    events = connect(serve()).send("/events")
    start = time.monotonic()
    assert [events.event()[0] for _ in range(3)] == ["beat"] * 3
    assert time.monotonic() - start < 3


def test_a_client_that_does_not_read_slows_nobody(serve, connect, live_result) -> None:
    server = serve()
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (720, 1280, 3), np.uint8)  # JPEGs of about 1 MB
    for path in ("/picture.mjpeg", "/events"):
        stalled = connect(server)
        stalled.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.send(path)
    reader = connect(server).send("/picture.mjpeg")
    spent_s, serials = [], []

    def read() -> None:
        while len(serials) < 5:
            serials.append(int(reader.picture()[0].get("X-Serial", 0)))

    thread = threading.Thread(target=read)
    thread.start()
    for number in range(200):
        result = live_result(number)
        start = time.perf_counter()
        server.publish(result, noise)
        spent_s.append(time.perf_counter() - start)
        time.sleep(0.01)
        if not thread.is_alive():
            break
    thread.join(timeout=10)
    assert len(serials) == 5
    assert serials == sorted(set(serials))
    assert float(np.median(spent_s)) < 0.001
    assert max(spent_s) < 1  # the machine may be busy


def test_a_client_that_does_not_read_is_disconnected(
    serve, connect, live_result, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(handler, "_SEND_S", 0.3)
    server = serve(max_clients=1)
    stalled = connect(server)
    stalled.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stalled.send("/picture.mjpeg")
    noise = np.random.default_rng(0).integers(0, 255, (720, 1280, 3), np.uint8)
    end_s = time.monotonic() + 15
    while time.monotonic() < end_s:
        server.publish(live_result(), noise)
        if connect(server).send("/picture.mjpeg").status() == 200:
            return
        time.sleep(0.1)
    pytest.fail("the stalled client keeps its place")


def test_one_client_too_many_is_told_so(serve, connect) -> None:
    server = serve(max_clients=1)
    first = connect(server).send("/events")
    first.event()
    second = connect(server).send("/events")
    assert second.status() == 503
    assert b"too many pages are open, 1 are allowed" in second.rest()
    first.socket.close()
    end_s = time.monotonic() + 10
    while connect(server).send("/events").status() != 200:
        assert time.monotonic() < end_s
        time.sleep(0.1)


def test_a_head_that_comes_too_slowly_ends_the_connection(
    serve, connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "_LONGEST_S", 0.5)
    client = connect(serve())
    start = time.monotonic()
    try:
        while time.monotonic() - start < 8:  # each byte in time, but not the whole
            client.socket.sendall(b"G")
            time.sleep(0.1)
    except OSError:
        pass
    assert time.monotonic() - start < 5


def test_random_bytes_do_no_harm(serve, connect, caplog: pytest.LogCaptureFixture) -> None:
    server = serve()
    rng = np.random.default_rng(3)
    seed = b"GET /events?token=abc HTTP/1.1\r\nHost: 127.0.0.1\r\nCookie: edgetree_1=%ff\r\n\r\n"
    for _ in range(150):
        content = bytearray(seed)
        for place in rng.integers(0, len(seed) - 4, rng.integers(1, 20)):
            content[place] = rng.integers(256)
        client = connect(server)
        client.socket.sendall(bytes(content))
        client.socket.close()
    for _ in range(50):
        client = connect(server)
        client.socket.sendall(rng.bytes(int(rng.integers(1, 3000))) + b"\r\n\r\n")
        client.socket.close()
    end_s = time.monotonic() + 10
    while connect(server).send("/").status() != 200:  # until the broken connections are gone
        assert time.monotonic() < end_s
        time.sleep(0.1)
    assert [record for record in caplog.records if record.levelname == "ERROR"] == []


def test_a_taken_port_is_told_in_one_line(serve) -> None:
    port = int(serve().address.split(":")[2].strip("/"))
    with pytest.raises(InputError) as told:
        PageServer(port=port).start()
    assert f"127.0.0.1 port {port}" in str(told.value)
    assert "expected" in str(told.value)
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"port": 70000}, "70000"),
        ({"stale_s": 0.0}, "0 s"),
        ({"max_clients": 0}, "max_clients is 0"),
        ({"token": "short"}, "5 characters"),
        ({"host": "192.0.2.7"}, "192.0.2.7"),
        ({"host": "no-such-machine.invalid"}, "no-such-machine.invalid"),
    ],
)
def test_values_that_cannot_be_used_are_named(settings: dict[str, object], told: str) -> None:
    with pytest.raises(InputError, match=re.escape(told)):
        PageServer(**{"port": 0, **settings}).start()  # type: ignore[arg-type]


def test_close_takes_less_than_a_second_and_frees_the_port(serve, connect, live_result) -> None:
    server = serve()
    port = int(server.address.split(":")[2].strip("/"))
    stalled = connect(server)
    stalled.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    stalled.send("/picture.mjpeg")
    watching = connect(server).send("/events")
    connect(server)  # says nothing
    server.publish(
        live_result(), np.random.default_rng(0).integers(0, 255, (720, 1280, 3), np.uint8)
    )
    watching.event()
    start = time.monotonic()
    server.close()
    assert time.monotonic() - start < 1
    watching.rest()
    left = [thread.name for thread in threading.enumerate()]
    assert not [name for name in left if name == "page" or "process_request" in name]
    with PageServer(port=port):
        pass


def test_close_waits_for_threads_that_are_slow_to_end(
    serve, connect, monkeypatch: pytest.MonkeyPatch
) -> None:
    end = socketserver.TCPServer.shutdown_request

    def end_slowly(*request: object) -> None:
        time.sleep(0.1)
        end(*request)

    monkeypatch.setattr(socketserver.TCPServer, "shutdown_request", end_slowly)
    server = serve()
    connect(server).send("/events").event()
    server.close()
    assert not [each.name for each in threading.enumerate() if "process_request" in each.name]


def test_closing_twice_or_without_a_start_is_harmless(live_result) -> None:
    server = PageServer(port=0)
    server.publish(live_result())
    server.close()
    server.close()
