"""Answers of the page's server: the page, its events and its pictures."""

from __future__ import annotations

import io
import json
import logging
import re
import socket
import time
from collections.abc import Callable, Iterator
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from typing import Any, Final

from basetree.errors import short_line
from edgetree.live.page.access import Refusal
from edgetree.live.page.document import page_html, security_headers
from edgetree.live.page.feed import Shown
from edgetree.live.page.http_server import PageHttpServer
from edgetree.live.page.pictures import blank_jpeg
from edgetree.live.page.reading import body_length, has_body, read_body, read_head
from edgetree.live.page.service import OPEN_PATHS, Answer, service_answer

_LOGGER: Final = logging.getLogger(__name__)
_SEND_S: Final = 5.0  # a client that takes longer for one picture is disconnected
_SEND_BUFFER_BYTES: Final = 262_144  # about two pictures: more would only be older when shown
_INTERVAL_S: Final = 0.1  # between two results of a stream
_BOUNDARY: Final = "edgetree-picture"
_QUERY: Final = re.compile(r"\?[^\s]*")


class PageHandler(BaseHTTPRequestHandler):
    """Answers the requests of one connection, in a thread of its own."""

    server: PageHttpServer
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    error_message_format = "%(code)d %(message)s\n"
    error_content_type = "text/plain; charset=utf-8"

    def handle(self) -> None:
        """Read the heads of requests, within limits of size and time, and answer."""
        self.requestline, self.request_version, self.command = "", self.protocol_version, ""
        self.close_connection = False
        while not self.close_connection:
            head = read_head(self.connection)
            self.connection.settimeout(_SEND_S)
            if head == b"":
                return
            if head is None:
                self.send_error(HTTPStatus.REQUEST_HEADER_FIELDS_TOO_LARGE)
                return
            self.rfile.close()
            self.rfile = io.BytesIO(head)
            self._has_body = has_body(head)
            self.handle_one_request()
            # What follows a request without a body is not read as another one.
            self.close_connection |= bool(self.rfile.read(1))

    def do_GET(self) -> None:  # the name is that of the library
        """Answer a request."""
        if self._has_body:
            self.send_error(HTTPStatus.BAD_REQUEST, "expected GET without a body")
            return
        path, _, query = self.path.partition("?")
        answers: dict[str, Callable[[], None]] = {
            "/": self._send_page,
            "/events": self._send_events,
            "/picture.jpg": lambda: self._send_picture(query),
            "/picture.mjpeg": self._send_pictures,
        }
        refusal = self._refusal(path, query)
        if refusal is not None:
            self.send_error(refusal.status, refusal.text)
        elif path in answers:
            answers[path]()
        elif (answer := service_answer(path, self.server.feed)) is not None:
            self._send_answer(answer)
        else:
            self.send_error(HTTPStatus.NOT_FOUND)

    def do_POST(self) -> None:  # the name is that of the library
        """Mark the seconds around now, with the body as the mark's text."""
        self.close_connection = True
        path, _, query = self.path.partition("?")
        refusal = self._refusal(path, query) or self._refusal_of_post(path)
        if refusal is not None:
            self.send_error(refusal.status, refusal.text)
            return
        length = body_length(self.headers)
        recorder = self.server.feed.recorder
        if isinstance(length, Refusal):
            self.send_error(length.status, length.text)
        elif recorder is None:
            self.send_error(HTTPStatus.CONFLICT, "recording is off: start edgetree with --record")
        elif (body := read_body(self.rfile, self.connection, length)) is not None:
            self.connection.settimeout(_SEND_S)
            kept_s = recorder.mark(" ".join(short_line(body.decode("utf-8", "replace")).split()))
            content = json.dumps({"kept_s": round(kept_s, 1)}).encode()
            self._start("application/json", {"Content-Length": str(len(content))})
            self.wfile.write(content)

    def _refusal_of_post(self, path: str) -> Refusal | None:
        if path != "/mark":
            return Refusal(HTTPStatus.METHOD_NOT_ALLOWED, "expected GET, or POST to /mark")
        headers = self.headers
        return self.server.access.refusal_of_origin(
            headers.get_all("Origin", []), headers.get_all("Host", [])
        )

    def _refusal(self, path: str, query: str) -> Refusal | None:
        access = self.server.access
        if self.request_version == "HTTP/0.9":  # whose answers have no headers
            return Refusal(HTTPStatus.HTTP_VERSION_NOT_SUPPORTED, "expected HTTP/1.1")
        if refusal := access.refusal_of_host(self.headers.get_all("Host", [])):
            return refusal
        if path != "/" and self.headers.get("Sec-Fetch-Site") in ("cross-site", "same-site"):
            return Refusal(HTTPStatus.FORBIDDEN, "another site asks for this")
        try:
            bearer = self.headers.get("Authorization", "")
            known = path in OPEN_PATHS or access.knows_token(
                query, self.headers.get("Cookie", ""), self._cookie, bearer
            )
        except ValueError:
            return Refusal(HTTPStatus.BAD_REQUEST, "the query has too many fields")
        if not known:
            text = "open the page by the address with the token that edgetree printed or got"
            return Refusal(HTTPStatus.FORBIDDEN, text)
        if not self.server.accept(self.connection):
            return Refusal(HTTPStatus.SERVICE_UNAVAILABLE, self.server.full_text)
        return None

    @property
    def _cookie(self) -> str:
        """Name of the cookie; browsers share cookies among the ports of a machine."""
        return f"edgetree_{self.server.server_port}"

    def _send_page(self) -> None:
        content, token = page_html(), self.server.access.token
        headers = {"Content-Length": str(len(content))}
        if token is not None:
            headers["Set-Cookie"] = f"{self._cookie}={token}; Path=/; HttpOnly; SameSite=Strict"
        self._start("text/html; charset=utf-8", headers)
        self.wfile.write(content)

    def _send_answer(self, answer: Answer) -> None:
        self.close_connection = True
        self.send_response(answer.status)
        self.send_header("Content-Type", answer.content_type)
        self.send_header("Content-Length", str(len(answer.content)))
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(answer.content)

    def _send_picture(self, query: str) -> None:
        """Send one picture, newer than the one that the client has; none if there is none soon."""
        feed = self.server.feed
        found = re.search(r"(?:^|&)after=(\d{1,15})(?:&|$)", query)
        shown = feed.wait(int(found[1]) if found else 0, timeout_s=feed.stale_s)
        if shown is None or feed.is_stale(shown):
            self.send_response(HTTPStatus.NO_CONTENT)
            self.end_headers()
            return
        jpeg = shown.jpeg()
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", "image/jpeg")
        self.send_header("Content-Length", str(len(jpeg)))
        for name, value in _about(shown).items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(jpeg)

    def _send_events(self) -> None:
        """Send the newest stems, or at least a heartbeat."""
        feed = self.server.feed
        with self.server.slot("events") as free:
            if not free:
                self._refuse_full()
                return
            self._start("text/event-stream; charset=utf-8")
            self.wfile.write(b"retry: 1000\n\n")
            for shown in self._newest(self.server.heartbeat_s):
                if shown is None:
                    self._send_event("beat", feed.status())
                else:
                    self._send_event("stems", {**shown.record(), **feed.status()})

    def _newest(self, timeout_s: float) -> Iterator[Shown | None]:
        """The newest result whenever there is one, None after each time without, to the end."""
        feed, serial = self.server.feed, 0
        while not feed.closed:
            shown = feed.wait(serial, timeout_s)
            yield shown
            if shown is not None:
                serial = shown.serial
                time.sleep(_INTERVAL_S)

    def _send_event(self, name: str, record: dict[str, Any]) -> None:
        data = json.dumps(record, allow_nan=False)
        self.wfile.write(f"event: {name}\ndata: {data}\n\n".encode())

    def _send_pictures(self) -> None:
        """Send the newest picture whenever the client has taken the last one."""
        with self.server.slot("pictures") as free:
            if not free:
                self._refuse_full()
                return
            self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
            self._start(f"multipart/x-mixed-replace; boundary={_BOUNDARY}")
            for shown in self._newest(self.server.feed.stale_s):
                if shown is None:
                    self._send_part(blank_jpeg(), {})
                else:
                    self._send_part(shown.jpeg(), _about(shown))

    def _send_part(self, jpeg: bytes, about: dict[str, str]) -> None:
        fields = {"Content-Type": "image/jpeg", "Content-Length": str(len(jpeg)), **about}
        head = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
        self.wfile.write(f"--{_BOUNDARY}\r\n{head}\r\n".encode() + jpeg + b"\r\n")

    def _refuse_full(self) -> None:
        self.send_error(HTTPStatus.SERVICE_UNAVAILABLE, self.server.full_text)

    def _start(self, content_type: str, headers: dict[str, str] | None = None) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", content_type)
        self.send_header("Connection", "close")
        for name, value in (headers or {}).items():
            self.send_header(name, value)
        self.end_headers()

    def end_headers(self) -> None:
        """End the head of an answer with the headers that protect the page."""
        for name, value in security_headers().items():
            self.send_header(name, value)
        super().end_headers()

    def version_string(self) -> str:
        """The `Server` header, without versions."""
        return "edgetree"

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 (the library's name)
        """Log quietly, without queries, which may hold the token."""
        text = _QUERY.sub("?...", format % args)
        _LOGGER.debug("%s %s", self.client_address[0], short_line(text))


def _about(shown: Shown) -> dict[str, str]:
    """Which result a picture shows, and when its frame arrived."""
    return {"X-Serial": str(shown.serial), "X-Taken-S": f"{shown.taken_s:.4f}"}
