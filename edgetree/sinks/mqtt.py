"""Stems and states for controllers, as messages of an MQTT broker."""

from __future__ import annotations

import logging
import sys
import time
from typing import TYPE_CHECKING, Any, Final

from basetree.errors import MissingPackage, install_hint
from edgetree.results.json_records import stems_message
from edgetree.results.service_state import ServiceState, state_message
from edgetree.sinks.mqtt_settings import MqttSettings
from edgetree.sinks.network import host_and_port

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult

_LOGGER: Final = logging.getLogger(__name__)
MQTT_PORT, _TLS_PORT = 1883, 8883
_MOST_BYTES: Final = 65_536
_KEEPALIVE_S: Final = 10  # the broker publishes the will after 15 s of silence
_LONGEST_WAIT_S: Final = 10  # until the next attempt to connect
_LEAVE_S: Final = 1.0  # for the last state to leave


class MqttSink:
    """Publishes the stems of each frame as a message of the schema `edgetree.live.stems/1`.

    Needs the extra `mqtt`. A thread connects, and again if the broker goes away. While the last
    message has not left, newer ones are not queued but lost. The state of the service is a retained
    message of the schema `edgetree.live.state/1`; if the service vanishes, the broker replaces it
    by the state "gone".

    Args:
        address: The broker, such as "192.168.1.20:1883" or "broker.local".
        settings: Topics, quality of service, user and encryption.

    Attributes:
        lost: Messages that were not sent.

    Raises:
        InputError: The address cannot be used, or a file cannot be read.
        MissingPackage: Paho-mqtt is not installed.
    """

    def __init__(self, address: str, settings: MqttSettings | None = None) -> None:
        self._settings = settings or MqttSettings()
        context = self._settings.tls_context()
        host, port = host_and_port(address, MQTT_PORT if context is None else _TLS_PORT)
        self.lost = 0
        self._broker = f"MQTT broker {host}:{port}"
        self._sequence = 0
        self._last: Any = None
        self._state: ServiceState | None = None
        self._fault = ""
        self._client = self._new_client()
        if context is not None:
            self._client.tls_set_context(context)
        self._client.connect_async(host, port, _KEEPALIVE_S)
        self._client.loop_start()

    def write(self, result: LiveResult) -> None:
        """Publish one message."""
        self._sequence += 1
        if not self._client.is_connected() or self._is_sending():
            self.lost += 1
            if self.lost == 1:
                _LOGGER.warning("a message to the broker was lost: it is not connected or too slow")
            return
        message = stems_message(result, _MOST_BYTES, self._sequence)
        self._last = self._client.publish(self._settings.topic, message, qos=self._settings.qos)

    def tell(self, state: ServiceState) -> None:
        """Publish a state that is new; without a connection, as soon as there is one."""
        if state is not self._state:
            self._state = state
            if self._client.is_connected():
                self._publish(state)

    def close(self) -> None:
        """Disconnect, once the last state has left or after a second."""
        end_s = time.monotonic() + _LEAVE_S
        while self._client.is_connected() and self._client.want_write():
            if time.monotonic() > end_s:
                break
            time.sleep(0.01)
        self._client.disconnect()
        self._client.loop_stop()

    def _new_client(self) -> Any:
        try:
            from paho.mqtt import client, enums
        except ImportError as error:
            raise MissingPackage(
                f"MQTT needs the package paho-mqtt: {install_hint('mqtt')}"
            ) from error
        made, settings = client.Client(enums.CallbackAPIVersion.VERSION2), self._settings
        if settings.user is not None:
            made.username_pw_set(settings.user, settings.password())
        gone = ServiceState("gone", "the connection to the service was lost")
        made.will_set(settings.state_topic, state_message(gone), qos=1, retain=True)
        made.reconnect_delay_set(1, _LONGEST_WAIT_S)
        made.on_connect, made.on_disconnect = self._connected, self._disconnected
        made.on_connect_fail = self._unreachable
        return made

    def _is_sending(self) -> bool:
        """Whether the last message has not left yet; with an error, it never will."""
        return self._last is not None and self._last.rc == 0 and not self._last.is_published()

    def _publish(self, state: ServiceState) -> None:
        # Of quality 0, as a message of another would be sent again after a newer state.
        self._client.publish(self._settings.state_topic, state_message(state), qos=0, retain=True)

    def _connected(self, client: Any, data: Any, flags: Any, reason: Any, more: Any) -> None:
        """Called by paho when the broker has answered."""
        if reason.is_failure:
            self._say(f"refuses the connection ({reason})")
            return
        if self._fault:
            _LOGGER.warning("%s is back", self._broker)
        self._fault = ""
        if self._state is not None:
            self._publish(self._state)

    def _disconnected(self, client: Any, data: Any, flags: Any, reason: Any, more: Any) -> None:
        """Called by paho when the connection has ended."""
        if reason.is_failure and not self._fault:
            self._say(f"is gone ({reason})")

    def _unreachable(self, client: Any, data: Any) -> None:
        """Called by paho when there was no connection, while it handles the error."""
        error = sys.exception()
        words = getattr(error, "verify_message", None) or getattr(error, "strerror", None)
        self._say(f"cannot be reached ({words or error or 'no answer'})")

    def _say(self, fault: str) -> None:
        """Say a fault once; it is tried again until the broker is there."""
        if fault != self._fault:
            self._fault = fault
            _LOGGER.warning("%s %s: it is tried again", self._broker, fault)
