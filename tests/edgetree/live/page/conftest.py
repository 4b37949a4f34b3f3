"""A page's server on a free port, and a client that speaks HTTP by hand."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from edgetree.live.page import PageServer
from edgetree.live.recording import RecorderStatus


class Client:
    """A connection to the server, and what it has answered so far."""

    def __init__(self, port: int) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=10)
        self.held = b""

    def send(self, path: str, *headers: str, host: str = "127.0.0.1") -> Client:
        lines = [f"GET {path} HTTP/1.1", f"Host: {host}", *headers]
        self.socket.sendall("".join(f"{line}\r\n" for line in [*lines, ""]).encode())
        return self

    def post(self, path: str, *headers: str, body: str = "", host: str = "127.0.0.1") -> Client:
        lines = [f"POST {path} HTTP/1.1", f"Host: {host}", *headers]
        head = "".join(f"{line}\r\n" for line in [*lines, f"Content-Length: {len(body)}", ""])
        self.socket.sendall((head + body).encode())
        return self

    def until(self, mark: bytes) -> bytes:
        """Read up to and with a mark."""
        while mark not in self.held:
            part = self.socket.recv(65536)
            assert part, f"the server ended with {self.held[-200:]!r}"
            self.held += part
        found, _, self.held = self.held.partition(mark)
        return found + mark

    def status(self) -> int:
        return int(self.until(b"\r\n").split()[1])

    def rest(self) -> bytes:
        """All up to the end of the connection."""
        parts = [self.held]
        while part := self.socket.recv(65536):
            parts.append(part)
        return b"".join(parts)

    def event(self) -> tuple[str, dict[str, Any]]:
        """The next event: its name and its object."""
        name = self.until(b"\ndata: ").rpartition(b"event: ")[2].partition(b"\n")[0]
        return name.decode(), json.loads(self.until(b"\n\n"))

    def picture(self) -> tuple[dict[str, str], bytes]:
        """The next picture: the fields of its head, and its JPEG."""
        self.until(b"--edgetree-picture\r\n")
        lines = self.until(b"\r\n\r\n").decode().strip().split("\r\n")
        fields = dict(line.split(": ", 1) for line in lines)
        return fields, self.exactly(int(fields["Content-Length"]))

    def exactly(self, length: int) -> bytes:
        """Read so many bytes."""
        while len(self.held) < length:
            part = self.socket.recv(65536)
            assert part
            self.held += part
        found, self.held = self.held[:length], self.held[length:]
        return found


class Recorder:
    """Takes marks as a `FrameRecorder` does."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.status = RecorderStatus(written=2)

    def mark(self, text: str = "") -> float:
        self.texts.append(text)
        return 4.96


@pytest.fixture
def recorder() -> Recorder:
    return Recorder()


@pytest.fixture
def serve() -> Iterator[Callable[..., PageServer]]:
    """A function that starts a server on a free port."""
    started: list[PageServer] = []

    def start(**settings: Any) -> PageServer:
        server = PageServer(**{"port": 0, **settings})
        started.append(server)
        server.start()
        return server

    yield start
    for server in started:
        server.close()


@pytest.fixture
def connect() -> Iterator[Callable[[PageServer], Client]]:
    """A function that connects to a server."""
    clients: list[Client] = []

    def make(server: PageServer) -> Client:
        port = int(server.address.split(":")[2].split("/")[0])
        clients.append(Client(port))
        return clients[-1]

    yield make
    for client in clients:
        client.socket.close()
