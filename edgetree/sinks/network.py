"""One JSON message for each frame and each state, for controllers, as UDP datagrams."""

from __future__ import annotations

import logging
import re
import socket
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import InputError, Unavailable
from edgetree.results.json_records import stems_message
from edgetree.results.service_state import ServiceState, state_message

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult

_LOGGER: Final = logging.getLogger(__name__)
_LEAST_BYTES, _MOST_BYTES = 256, 65_507


class UdpSink:
    """Sends the stems of each frame as one datagram of the schema `edgetree.live.stems/1`.

    The state of the service goes there too, at each change and every second. Datagrams are numbered
    by `sequence` from 1 on. Sending never waits. Datagrams may be lost on the way.

    Args:
        address: Where to send, such as "192.168.1.20:9000".
        max_bytes: Limit of a datagram, 256 to 65507 bytes. 1400 bytes, about 6 stems, fit into one
            packet of Ethernet. The farthest stems are left out and counted in the message.

    Attributes:
        lost: Datagrams that could not be sent.

    Raises:
        InputError: The address or the limit cannot be used.
        Unavailable: The name of the host is not known.
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
            raise Unavailable(
                f"{address} is not known ({error.strerror}): expected the address of a controller"
            ) from error
        self.lost = 0
        self._where: Any = where
        self._max_bytes = max_bytes
        self._lock, self._sent = threading.Lock(), 0
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)

    def write(self, result: LiveResult) -> None:
        """Send one datagram."""
        self._send(lambda number: stems_message(result, self._max_bytes, number))

    def tell(self, state: ServiceState) -> None:
        """Send the state as one datagram; may be called from another thread."""
        self._send(lambda number: state_message(state, number))

    def _send(self, message: Callable[[int], bytes]) -> None:
        with self._lock:
            self._sent += 1
            try:
                self._socket.sendto(message(self._sent), self._where)
            except OSError as error:
                self.lost += 1
                if self.lost == 1:
                    _LOGGER.warning("a datagram to %s was lost: %s", self._where[0], error.strerror)

    def close(self) -> None:
        """Stop sending."""
        self._socket.close()


def host_and_port(text: str, default_port: int | None = None) -> tuple[str, int]:
    """Split an address such as "192.168.1.20:9000" or "[fe80::1]:9000".

    Raises:
        InputError: It is not of this form.
    """
    found = re.fullmatch(r"(\[[0-9A-Fa-f:.%\w]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?", text)
    port = found[2] if found is not None and found[2] is not None else default_port
    if found is None or port is None or not 1 <= int(port) <= 65535:
        example = "192.168.1.20:9000" if default_port is None else f"192.168.1.20:{default_port}"
        raise InputError(f"the address is {text!r}: expected HOST:PORT, such as {example}")
    return found[1].strip("[]"), int(port)
