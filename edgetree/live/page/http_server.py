"""The HTTP server of the page: a thread for each connection, within limits."""

from __future__ import annotations

import logging
import os
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import Enum, auto
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any, Final
from weakref import WeakSet

from edgetree.live.page.access import Access
from edgetree.live.page.feed import Feed

_LOGGER: Final = logging.getLogger(__name__)
_MOST_NEW: Final = 32  # connections whose first request has not been accepted yet


class _State(Enum):
    """Of a connection."""

    NEW = auto()
    ACCEPTED = auto()
    ENDING = auto()


class PageHttpServer(ThreadingHTTPServer):
    """One thread for each connection, with limits.

    Connections whose first request has not been accepted yet are counted apart: when there are too
    many, the oldest of them is ended. So strangers who are slow, or do not know the token, cannot
    keep out those who do.

    Attributes:
        access: Who may open the page.
        feed: The newest result.
        heartbeat_s: Longest time between two events, s.
        full_text: What a client is told that is one too many.
    """

    daemon_threads = True
    request_queue_size = 256
    # On Windows this would let two servers share a port.
    allow_reuse_address = os.name != "nt"
    allow_reuse_port = False

    def __init__(
        self,
        where: tuple[str, int],
        handler: type[BaseHTTPRequestHandler],
        access: Access,
        feed: Feed,
        max_clients: int,
    ) -> None:
        self.address_family = socket.AF_INET6 if ":" in where[0] else socket.AF_INET
        self.access, self.feed = access, feed
        self.heartbeat_s = min(0.5, feed.stale_s / 2)
        self.full_text = f"too many pages are open, {max_clients} are allowed: close one of them"
        self._max_clients = max_clients
        self._lock = threading.Lock()
        self._used: Counter[str] = Counter()
        self._most_accepted = 4 * max_clients + 8
        self._open: dict[socket.socket, _State] = {}  # in the order of their beginning
        self._answering: WeakSet[threading.Thread] = WeakSet()
        super().__init__(where, handler)

    def server_bind(self) -> None:
        """Bind without looking up names, which may wait for the network."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, self.allow_reuse_address)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()
        self.server_name, self.server_port = str(self.server_address[0]), self.server_address[1]

    @contextmanager
    def slot(self, kind: str) -> Iterator[bool]:
        """Take one of the slots for a kind of stream; yields whether one was free."""
        with self._lock:
            free = self._used[kind] < self._max_clients
            self._used[kind] += free
        try:
            yield free
        finally:
            with self._lock:
                self._used[kind] -= free

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread, or not at all if far too many connections are open."""
        with self._lock:
            new = [each for each, state in self._open.items() if state is _State.NEW]
            full = len(self._open) >= self._most_accepted + 4 * _MOST_NEW
            if len(new) >= _MOST_NEW:
                self._open[new[0]] = _State.ENDING
                with suppress(OSError):
                    new[0].shutdown(socket.SHUT_RDWR)
            if not full:
                self._open[request] = _State.NEW
        if not full:
            super().process_request(request, client_address)
            return
        with suppress(OSError):
            request.settimeout(0.0)
            text = f"503 {self.full_text}\n"
            head = f"HTTP/1.1 503 Service Unavailable\r\nContent-Length: {len(text)}\r\n"
            request.send(f"{head}Connection: close\r\n\r\n{text}".encode())
        self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer; `disconnect` waits for this thread."""
        with self._lock:
            self._answering.add(threading.current_thread())
        super().process_request_thread(request, client_address)

    def accept(self, request: Any) -> bool:
        """Keep a connection, as its client may open the page; False if too many are kept."""
        with self._lock:
            others = (state for each, state in self._open.items() if each is not request)
            if sum(state is _State.ACCEPTED for state in others) >= self._most_accepted:
                return False
            if self._open.get(request) is _State.NEW:
                self._open[request] = _State.ACCEPTED
            return True

    def shutdown_request(self, request: Any) -> None:
        """End a connection."""
        with self._lock:
            self._open.pop(request, None)
        super().shutdown_request(request)

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log what went wrong with a client; one that left or stalled is no error."""
        error = sys.exception()
        if isinstance(error, OSError):
            _LOGGER.debug("%s: %s", client_address[0], error)
        else:
            _LOGGER.exception("the answer to %s failed", client_address[0])

    def disconnect(self, timeout_s: float) -> None:
        """End all connections, and wait for their threads."""
        with self._lock:
            for connection in self._open:
                with suppress(OSError):
                    connection.shutdown(socket.SHUT_RDWR)
        end_s = time.monotonic() + timeout_s
        while self._open and time.monotonic() < end_s:
            time.sleep(0.01)
        with self._lock:
            answering = list(self._answering)
        for thread in answering:
            thread.join(max(end_s - time.monotonic(), 0.0))
