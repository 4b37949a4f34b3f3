"""Counts the connections of a socket of ZeroMQ, and ends those that are too many."""

from __future__ import annotations

import os
import socket
import struct
from contextlib import suppress
from typing import Any, Final

from edgetree.serve.faults import Faults

_OPEN_FILES: Final = 8192


class Connections:
    """Ends each new connection of a socket once there are as many as may be.

    ZeroMQ itself has no such limit. Once the process had no files left, it would try without end to
    accept the next program, with a whole core. A program that is turned away comes again by itself.
    All methods are for the thread of the socket.

    Args:
        zmq: The module of ZeroMQ.
        context: Its context.
        listening: The socket, before it is bound.
        most: The largest number of connections.
        faults: Where those that are turned away are noted.

    Attributes:
        events: A socket that has something to read when `follow` has something to do.
    """

    def __init__(self, zmq: Any, context: Any, listening: Any, most: int, faults: Faults) -> None:
        self._zmq, self._listening, self._most, self._faults = zmq, listening, most, faults
        self._count = 0
        name = f"inproc://connections-{id(self)}"
        listening.monitor(name, zmq.EVENT_ACCEPTED | zmq.EVENT_DISCONNECTED)
        self.events = context.socket(zmq.PAIR)
        self.events.setsockopt(zmq.RCVHWM, 0)  # with a limit, ZeroMQ would wait for this thread
        self.events.connect(name)

    def follow(self) -> None:
        """Count who came and left, and end what is too many."""
        with suppress(self._zmq.Again):
            while True:
                event = self.events.recv_multipart(self._zmq.NOBLOCK)[0]
                kind, file = struct.unpack_from("=Hi", event)
                if kind == self._zmq.EVENT_DISCONNECTED:
                    self._count -= 1
                    continue
                self._count += 1
                if self._count > self._most:
                    self._end(file)

    def _end(self, file: int) -> None:
        error = f"{self._most} programs are connected: expected no more; it is turned away"
        self._faults.note("program too many", error)
        # It may have left already. ZeroMQ closes the file itself.
        with suppress(OSError):
            connection = socket.socket(fileno=file)
            try:
                if connection.getsockname() == self._address():
                    connection.shutdown(socket.SHUT_RDWR)
            finally:
                connection.detach()

    def _address(self) -> tuple[str, int] | str:
        form, _, place = self._listening.getsockopt_string(self._zmq.LAST_ENDPOINT).partition("://")
        host, _, port = place.rpartition(":")
        return place if form == "ipc" else (host, int(port))

    def close(self) -> None:
        """Count no more."""
        if not self._listening.closed:
            self._listening.disable_monitor()
        self.events.close()


def most_connections() -> int:
    """Raise the number of files that the process may open; returns half of it for connections."""
    if os.name == "nt":
        return _OPEN_FILES // 2
    import resource

    with suppress(ValueError, OSError):
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        wanted = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(_OPEN_FILES, hard)
        if soft != resource.RLIM_INFINITY and soft < wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
    files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return (_OPEN_FILES if files == resource.RLIM_INFINITY else min(files, _OPEN_FILES)) // 2
