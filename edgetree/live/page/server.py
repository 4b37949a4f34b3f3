"""The page's server: publishes results to browsers without ever slowing the publisher."""

from __future__ import annotations

import errno
import logging
import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from basetree.errors import InputError, Unavailable
from basetree.secrets import hide_secrets
from edgetree.drawing.primitives import Picture
from edgetree.live.page.access import Access
from edgetree.live.page.feed import Feed
from edgetree.live.page.handler import PageHandler
from edgetree.live.page.http_server import PageHttpServer
from edgetree.live.results import LiveResult

if TYPE_CHECKING:
    from edgetree.live.health import ServiceHealth
    from edgetree.live.recording import FrameRecorder

_LOGGER: Final = logging.getLogger(__name__)
_POLL_S: Final = 0.05
_CLOSE_S: Final = 0.6
_AGAIN_S: Final = 5.0
_PASSING: Final = (errno.EADDRINUSE, errno.EADDRNOTAVAIL)
_EVERYWHERE: Final = ("", "0.0.0.0", "::")


class PageServer:
    """Serves the page for the cab.

        with PageServer() as page:
            print(page.address)
            for result in results:
                page.publish(result)

    The page shows the newest result only. Pictures are drawn and encoded in a thread of their own,
    once per frame, and only if a client watches.

    Args:
        host: Address to listen on. Any other than loopback needs a token.
        port: Port; 0 for any free one.
        token: What a client must know, 16 to 128 letters, digits, - or _. If None, a random one is
            made, or none on loopback.
        stale_s: Age from which results are blanked, s.
        max_clients: Largest number of open pages.
        recorder: Records what clients mark; if None, they cannot.
        health: Says how the service goes, at /healthz, /readyz, /metrics and /version.

    Attributes:
        address: What to open in a browser, with the token. Known after `start`.
        stale_s: As given.

    Raises:
        InputError: a value cannot be used.
    """

    def __init__(
        self,
        host: str = "127.0.0.1",
        port: int = 8420,
        token: str | None = None,
        stale_s: float = 1.0,
        max_clients: int = 8,
        recorder: FrameRecorder | None = None,
        health: ServiceHealth | None = None,
    ) -> None:
        if not 0 <= port <= 65535:
            raise InputError(
                f"--port of the page is {port}: expected 1 to 65535, or 0 for a free one"
            )
        if not 0.1 <= stale_s <= 60:
            raise InputError(f"stale_s is {stale_s:g} s: expected 0.1 to 60 s")
        if max_clients < 1:
            raise InputError(f"max_clients is {max_clients}: expected at least 1")
        self.address = ""
        self.stale_s = stale_s
        self._where = (host, port)
        self._access = Access(host, token)
        self._is_token_given = token is not None
        self._feed = Feed(stale_s, recorder, health)
        self._max_clients = max_clients
        self._http: PageHttpServer | None = None
        self._thread: threading.Thread | None = None
        self._waiting: threading.Thread | None = None
        self._closing = threading.Event()

    def start(
        self, *, waits: bool = False, on_served: Callable[[str], object] | None = None
    ) -> None:
        """Start to listen.

        Args:
            waits: Whether a port that is taken is waited for, in a thread, instead of an error.
            on_served: Called with what may be printed of `address` once the page is there, from
                that thread if it waited: a token that was given is hidden.

        Raises:
            Unavailable: The port is taken, or the address is not one of this machine.
            InputError: The address cannot be used.
        """
        try:
            self._listen()
        except Unavailable as error:
            if not waits:
                raise
            _LOGGER.warning("%s; it is tried again every %g s", error, _AGAIN_S)
            self._waiting = threading.Thread(
                target=self._wait, args=(on_served,), name="page-wait", daemon=True
            )
            self._waiting.start()
            return
        if on_served is not None:
            on_served(self._shown_address())

    def _wait(self, on_served: Callable[[str], object] | None) -> None:
        """The thread that waits for the port."""
        while not self._closing.wait(_AGAIN_S):
            try:
                self._listen()
            except Unavailable:
                continue
            _LOGGER.warning("the page is served at last: port %d is free", self._where[1])
            if on_served is not None:
                on_served(self._shown_address())
            return

    def _shown_address(self) -> str:
        return hide_secrets(self.address) if self._is_token_given else self.address

    def _listen(self) -> None:
        host, port = self._where
        try:
            self._http = PageHttpServer(
                (host, port), PageHandler, self._access, self._feed, self._max_clients
            )
        except OSError as error:
            kind = Unavailable if error.errno in _PASSING else InputError
            raise kind(
                f"the page cannot be served at {host} port {port} ({error.strerror}):"
                " expected an address of this machine and a free port"
            ) from error
        self.address = _address(host, self._http.server_port, self._access.token)
        self._thread = threading.Thread(
            target=self._http.serve_forever, args=(_POLL_S,), name="page", daemon=True
        )
        self._thread.start()
        _LOGGER.info("the page is served at %s port %d", host, self._http.server_port)

    def publish(self, result: LiveResult, picture: Picture | None = None) -> None:
        """Show a result. Takes microseconds, whatever the clients do.

        Args:
            result: The result. It must not be changed afterwards.
            picture: (H, W, 3) uint8 BGR to show, which must not be changed afterwards. If None, the
                trees are drawn on the frame's image.
        """
        self._feed.put(result, picture)

    def close(self) -> None:
        """Disconnect all clients and stop listening, within a second."""
        self._feed.close()
        self._closing.set()
        if self._waiting is not None:
            self._waiting.join()
        if self._http is not None and self._thread is not None:
            self._http.shutdown()
            self._http.server_close()
            self._http.disconnect(_CLOSE_S)
            self._thread.join()
            self._http = None

    def __enter__(self) -> PageServer:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _address(host: str, port: int, token: str | None) -> str:
    name = socket.gethostname() if host in _EVERYWHERE else host
    name = f"[{name}]" if ":" in name else name
    return f"http://{name}:{port}/" + ("" if token is None else f"?token={token}")
