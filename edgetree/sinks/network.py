"""One JSON message for each frame, for controllers: as a UDP datagram, or to an MQTT broker."""

from __future__ import annotations

import logging
import re
import socket
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import InputError, MissingPackage, install_hint
from edgetree.results.json_records import stems_message

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult

_LOGGER: Final = logging.getLogger(__name__)
_LEAST_BYTES, _MOST_BYTES = 256, 65_507
_MQTT_PORT: Final = 1883
_MQTT_BYTES: Final = 65_536


class UdpSink:
    """Sends the stems of each frame as one datagram of the schema `edgetree.live.stems/1`.

    Sending never waits. Datagrams may be lost on the way.

    Args:
        address: Where to send, such as "192.168.1.20:9000".
        max_bytes: Limit of a datagram, 256 to 65507 bytes. 1400 bytes, about 6 stems, fit into one
            packet of Ethernet. The farthest stems are left out and counted in the message.

    Attributes:
        lost: Datagrams that could not be sent.

    Raises:
        InputError: The address or the limit cannot be used.
    """

    def __init__(self, address: str, max_bytes: int = 1400) -> None:
        host, port = _host_and_port(address)
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


class MqttSink:
    """Publishes the stems of each frame as a message of the schema `edgetree.live.stems/1`.

    Needs the extra `mqtt`. A thread connects, and again if the broker goes away. Messages have
    quality of service 0; while the last one has not left, newer ones are not queued but lost.

    Args:
        address: The broker, such as "192.168.1.20:1883" or "broker.local".
        topic: Topic of the messages, without wildcards.
        username: Name at the broker; none if None.
        password: Password at the broker.

    Attributes:
        lost: Messages that were not sent.

    Raises:
        InputError: The address or the topic cannot be used.
        MissingPackage: Paho-mqtt is not installed.
    """

    def __init__(
        self,
        address: str,
        topic: str = "edgetree/stems",
        username: str | None = None,
        password: str | None = None,
    ) -> None:
        host, port = _host_and_port(address, _MQTT_PORT)
        if not topic or len(topic) > 1000 or set("+#\0") & set(topic):
            raise InputError(f"the topic is {topic!r}: expected a name without + and #")
        self.lost = 0
        self._topic = topic
        self._last: Any = None
        self._client = _new_client()
        if username is not None:
            self._client.username_pw_set(username, password)
        self._client.connect_async(host, port)
        self._client.loop_start()

    def write(self, result: LiveResult) -> None:
        """Publish one message."""
        if not self._client.is_connected() or self._is_sending():
            self.lost += 1
            if self.lost == 1:
                _LOGGER.warning("a message to the broker was lost: it is not connected or too slow")
            return
        self._last = self._client.publish(self._topic, stems_message(result, _MQTT_BYTES), qos=0)

    def _is_sending(self) -> bool:
        """Whether the last message has not left yet; with an error, it never will."""
        return self._last is not None and self._last.rc == 0 and not self._last.is_published()

    def close(self) -> None:
        """Disconnect."""
        self._client.disconnect()
        self._client.loop_stop()


def _new_client() -> Any:
    try:
        from paho.mqtt import client
    except ImportError as error:
        raise MissingPackage(f"MQTT needs the package paho-mqtt: {install_hint('mqtt')}") from error
    return client.Client(client.CallbackAPIVersion.VERSION2)


def _host_and_port(text: str, default_port: int | None = None) -> tuple[str, int]:
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
