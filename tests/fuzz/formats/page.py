"""Requests to the page of `edgetree live`."""

from __future__ import annotations

import json
import socket
from functools import cache
from pathlib import Path

from edgetree.live.page.access import Access
from edgetree.live.page.feed import Feed
from edgetree.live.page.handler import PageHandler
from edgetree.live.page.http_server import PageHttpServer
from edgetree.live.recording import FrameRecorder
from formats.form import Format

_REQUEST = (
    b"GET /events?token=0123456789abcdef HTTP/1.1\r\nHost: 127.0.0.1:8420\r\n"
    b"Cookie: a=b; edgetree_8420=0123456789abcdef\r\nSec-Fetch-Site: same-origin\r\n\r\n"
)
_MARK = _REQUEST.replace(b"GET /events", b"POST /mark").replace(
    b"Sec-Fetch-Site: same-origin",
    b"Origin: http://127.0.0.1:8420\r\nContent-Length: 14",
)
_MARK += b"wrong diameter"


class _Recorder(FrameRecorder):
    """A recorder that writes nothing."""

    def __init__(self) -> None:
        self.texts: list[str] = []

    def mark(self, text: str = "") -> float:
        self.texts.append(json.dumps(text))
        return 5.0


@cache
def _page_server() -> PageHttpServer:
    """A server of the page that is about to close, so that streams end at once."""
    feed = Feed(stale_s=1.0, recorder=_Recorder())
    feed.close()
    access = Access("127.0.0.1", "0123456789abcdef")
    return PageHttpServer(("127.0.0.1", 0), PageHandler, access, feed, 1)


class _PageHandler(PageHandler):
    disable_nagle_algorithm = False  # which only TCP has


def _answer(path: Path) -> bytes:
    """The answer of the page's server to a request."""
    client, server = socket.socketpair()
    with client, server:
        client.sendall(path.read_bytes()[:100_000])
        client.shutdown(socket.SHUT_WR)
        _PageHandler(server, ("127.0.0.1", 1), _page_server())
        server.shutdown(socket.SHUT_WR)
        return b"".join(iter(lambda: client.recv(65_536), b""))


FORMATS = {
    "request": Format((_REQUEST, _REQUEST.replace(b"events", b""), _MARK), _answer),
}
