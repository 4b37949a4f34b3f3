"""One JSON message for each frame to an MQTT broker. Needs the extra `mqtt`."""

from __future__ import annotations

import logging
from typing import Any, Final

from basetree.errors import InputError, MissingPackage, install_hint
from edgetree.live.results import LiveResult
from edgetree.live.sinks.addresses import host_and_port
from edgetree.live.sinks.records import stems_message

__all__ = ["MqttSink"]

_LOGGER: Final = logging.getLogger(__name__)
_PORT: Final = 1883
_MAX_BYTES: Final = 65_536


class MqttSink:
    """Publishes the stems of each frame as a message of the schema `edgetree.live.stems/1`.

    A thread connects, and again if the broker goes away. Messages have quality of service 0; while
    the last one has not left, newer ones are not queued but lost.

    Args:
        address: the broker, such as "192.168.1.20:1883" or "broker.local".
        topic: topic of the messages, without wildcards.
        username: name at the broker; none if None.
        password: password at the broker.

    Attributes:
        lost: messages that were not sent.

    Raises:
        InputError: the address or the topic cannot be used.
        MissingPackage: paho-mqtt is not installed.
    """

    def __init__(
        self,
        address: str,
        topic: str = "edgetree/stems",
        username: str | None = None,
        password: str | None = None,
    ) -> None:
        host, port = host_and_port(address, _PORT)
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
        self._last = self._client.publish(self._topic, stems_message(result, _MAX_BYTES), qos=0)

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
