"""One JSON datagram for each frame, for controllers."""

from __future__ import annotations

import logging
import socket
from typing import Any, Final

from basetree.errors import InputError
from edgetree.live.results import LiveResult
from edgetree.live.sinks.addresses import host_and_port
from edgetree.live.sinks.records import stems_message

__all__ = ["UdpSink"]

_LOGGER: Final = logging.getLogger(__name__)
_LEAST_BYTES, _MOST_BYTES = 256, 65_507


class UdpSink:
    """Sends the stems of each frame as one datagram of the schema `edgetree.live.stems/1`.

    Sending never waits. Datagrams may be lost on the way.

    Args:
        address: where to send, such as "192.168.1.20:9000".
        max_bytes: limit of a datagram, 256 to 65507 bytes. 1400 bytes, about 6 stems, fit into one
            packet of Ethernet. The farthest stems are left out and counted in the message.

    Attributes:
        lost: datagrams that could not be sent.

    Raises:
        InputError: the address or the limit cannot be used.
    """

    def __init__(self, address: str, max_bytes: int = 1400) -> None:
        host, port = host_and_port(address)
        if not _LEAST_BYTES <= max_bytes <= _MOST_BYTES:
            raise InputError(
                f"max_bytes is {max_bytes}: expected {_LEAST_BYTES} to {_MOST_BYTES} bytes"
            )
        try:
            family, _, _, _, where = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        except OSError as error:
            raise InputError(
                f"{address} is not known ({error.strerror}): expected the address of a controller"
            ) from error
        self.lost = 0
        self._where: Any = where
        self._max_bytes = max_bytes
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def write(self, result: LiveResult) -> None:
        """Send one datagram."""
        try:
            self._socket.sendto(stems_message(result, self._max_bytes), self._where)
        except OSError as error:
            self.lost += 1
            if self.lost == 1:
                _LOGGER.warning("a datagram to %s was lost: %s", self._where[0], error.strerror)

    def close(self) -> None:
        """Stop sending."""
        self._socket.close()
