"""Read requests, within limits of size and time."""

from __future__ import annotations

import re
import socket
import time
from email.message import Message
from http import HTTPStatus
from io import BufferedIOBase
from typing import Final

from edgetree.live.page.access import Refusal

_MAX_HEAD_BYTES: Final = 16_384
_MAX_BODY_BYTES: Final = 1000
_LONGEST_S: Final = 5.0
_BODY_FIELD: Final = re.compile(rb"(?im)^\s*(?:transfer-encoding|content-length)\s*:(?!\s*0\s*$)")


def read_head(connection: socket.socket) -> bytes | None:
    """The head of a request; empty if the client leaves, None if it is too large.

    What has come of the body follows it.
    """
    head, end_s = b"", time.monotonic() + _LONGEST_S
    while b"\r\n\r\n" not in head and b"\n\n" not in head:
        connection.settimeout(max(end_s - time.monotonic(), 0.001))
        part = connection.recv(65_536)
        if not part:
            return b""
        head += part
        if len(head) > _MAX_HEAD_BYTES:
            return None
    return head


def has_body(head: bytes) -> bool:
    """Whether the head of a request, however it is written, says that a body follows."""
    return _BODY_FIELD.search(head.partition(b"\r\n\r\n")[0]) is not None


def body_length(headers: Message) -> int | Refusal:
    """How many bytes the body has, or why it is refused."""
    lengths = headers.get_all("Content-Length", ["0"])
    if "Transfer-Encoding" in headers or len(lengths) != 1:
        return Refusal(HTTPStatus.LENGTH_REQUIRED, "expected one header Content-Length")
    if not re.fullmatch("[0-9]{1,18}", lengths[0].strip()):
        return Refusal(HTTPStatus.BAD_REQUEST, "expected a number as Content-Length")
    length = int(lengths[0])
    if length > _MAX_BODY_BYTES:
        text = f"the text has {length} bytes: expected at most {_MAX_BODY_BYTES}"
        return Refusal(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, text)
    return length


def read_body(begun: BufferedIOBase, connection: socket.socket, length: int) -> bytes | None:
    """The body of a request; None if the client leaves before its end.

    Args:
        begun: What has come of the body.
        connection: Where the rest comes from.
        length: Its length in bytes.
    """
    body, end_s = begun.read(length), time.monotonic() + _LONGEST_S
    while len(body) < length:
        connection.settimeout(max(end_s - time.monotonic(), 0.001))
        part = connection.recv(length - len(body))
        if not part:
            return None
        body += part
    return body
