"""Tell systemd, or another supervisor that speaks its protocol, how a service goes.

The protocol is a datagram of lines NAME=VALUE to the socket that `NOTIFY_SOCKET` names, as
sd_notify(3) describes it.
"""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

from basetree.errors import short_line

_US: Final = 1_000_000


class Supervisor:
    """The supervisor of this process; without one, nothing is sent.

    Args:
        environment: Variables of the process; those of `os.environ` if None.

    Attributes:
        watchdog_s: Time after which the supervisor ends a process that it has not heard of, s; None
            if it does not watch.
    """

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        given = os.environ if environment is None else environment
        self._address = given.get("NOTIFY_SOCKET", "")
        limit_us, process = given.get("WATCHDOG_USEC", ""), given.get("WATCHDOG_PID", "")
        is_meant = process in ("", str(os.getpid()))
        is_watched = bool(self._address) and is_meant and limit_us.isdecimal() and int(limit_us) > 0
        self.watchdog_s = int(limit_us) / _US if is_watched else None

    def ready(self) -> None:
        """The service has started."""
        self._send("READY=1")

    def status(self, text: str) -> None:
        """Say in one line how it goes."""
        self._send(f"STATUS={short_line(text)}")

    def alive(self) -> None:
        """The service works; call it at least every half of `watchdog_s`."""
        if self.watchdog_s is not None:
            self._send("WATCHDOG=1")

    def stopping(self) -> None:
        """The service ends."""
        self._send("STOPPING=1")

    def _send(self, line: str) -> None:
        """Send a line; a supervisor that is gone or busy is no fault of the service."""
        if not self._address.startswith(("/", "@")) or not hasattr(socket, "AF_UNIX"):
            return
        where = self._address.replace("@", "\0", 1) if self._address[0] == "@" else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            sender.setblocking(False)
            sender.sendto(line.encode(), where)
