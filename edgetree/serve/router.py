"""The service's end of ZeroMQ: one socket that tells programs apart and waits for none of them."""

from __future__ import annotations

import errno
import os
import re
import socket
from contextlib import suppress
from typing import Any, Final, Literal, NamedTuple, TypeAlias

from basetree.errors import InputError, MissingPackage, install_hint
from edgetree.serve.handed import LARGEST_PART_BYTES

Sender: TypeAlias = tuple[bytes, ...]
"""What stands before a program's messages: its number and, of a REQ socket, an empty part."""

_FORMS: Final = "tcp://127.0.0.1:PORT or ipc://FILE: the service is for programs on this machine"
_TCP: Final = re.compile(r"tcp://(127\.0\.0\.1|localhost):(\d{1,5})")
_IPC: Final = re.compile(r"ipc://(/.+)")
_WAITING: Final = 4  # messages of one program that wait for the service
_UNREAD: Final = 64  # answers that wait for one program
_HEARTBEAT_MS, _DEAD_MS = 2000, 6000
_BACKLOG: Final = 1024
_LAST_ANSWERS_MS: Final = 200
_OPEN_FILES: Final = 8192


class Letter(NamedTuple):
    """A message and who sent it."""

    sender: Sender
    parts: list[memoryview]


def zeromq() -> Any:
    """The module of ZeroMQ.

    Raises:
        MissingPackage: It is not installed.
    """
    try:
        import zmq
    except ImportError as error:
        raise MissingPackage(f"--serve needs the package pyzmq: {install_hint('serve')}") from error
    return zmq


def endpoint(address: str) -> str:
    """What ZeroMQ calls an address; port 0 is any free one.

    Raises:
        InputError: It is of another form.
    """
    tcp = _TCP.fullmatch(address)
    if tcp is not None and int(tcp[2]) <= 65535:
        return f"tcp://127.0.0.1:{tcp[2]}" if int(tcp[2]) else "tcp://127.0.0.1:*"
    if _IPC.fullmatch(address):
        return address
    raise InputError(f"the address of the service is {address!r}: expected {_FORMS}")


class Router:
    """Receives messages of many programs, and sends each of them its answers.

    All methods but `wake` are for one thread.

    Args:
        address: Where to listen.

    Attributes:
        address: Where it listens, with the port.

    Raises:
        InputError: The address cannot be used, or is taken.
        MissingPackage: ZeroMQ is not installed.
    """

    def __init__(self, address: str) -> None:
        self._zmq = zmq = zeromq()
        where = endpoint(address)
        _allow_connections()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.ROUTER)
        self._set_options()
        try:
            _check_not_taken(address)
            self._socket.bind(where)
        except (zmq.ZMQError, OSError) as error:
            self._context.destroy(linger=0)
            raise InputError(
                f"the service cannot listen at {address} ({_reason(error)}): expected a free"
                " port, or a file in a folder that exists"
            ) from error
        self.address = self._socket.getsockopt_string(zmq.LAST_ENDPOINT)
        self._bell, self._ringer = socket.socketpair()
        self._bell.setblocking(False)
        self._ringer.setblocking(False)
        self._poller = zmq.Poller()
        self._poller.register(self._socket, zmq.POLLIN)
        self._poller.register(self._bell, zmq.POLLIN)

    def _set_options(self) -> None:
        zmq = self._zmq
        for option, value in {
            zmq.MAXMSGSIZE: LARGEST_PART_BYTES,
            zmq.RCVHWM: _WAITING,
            zmq.SNDHWM: _UNREAD,
            zmq.ROUTER_MANDATORY: 1,
            zmq.HEARTBEAT_IVL: _HEARTBEAT_MS,
            zmq.HEARTBEAT_TIMEOUT: _DEAD_MS,
            zmq.BACKLOG: _BACKLOG,
            zmq.LINGER: _LAST_ANSWERS_MS,
        }.items():
            self._socket.setsockopt(option, value)

    def wake(self) -> None:
        """End `wait` in the other thread. For any thread."""
        with suppress(OSError):  # full, which wakes too, or closed
            self._ringer.send(b"\0")

    def wait(self, longest_s: float) -> None:
        """Wait for a message or `wake`."""
        self._poller.poll(longest_s * 1000)
        with suppress(BlockingIOError):
            self._bell.recv(4096)

    def receive(self) -> Letter | None:
        """The next message; None if there is none now."""
        try:
            frames = self._socket.recv_multipart(self._zmq.NOBLOCK, copy=False)
        except self._zmq.Again:
            return None
        parts = [frame.buffer for frame in frames]
        head = 2 if len(parts) > 2 and not len(parts[1]) else 1
        return Letter(tuple(map(bytes, parts[:head])), parts[head:])

    def send(self, sender: Sender, text: bytes) -> Literal["sent", "unread", "gone"]:
        """Send an answer, without waiting.

        Returns:
            "unread" if too many answers wait for the program, "gone" if it is not connected.
        """
        try:
            self._socket.send_multipart([*sender, text], self._zmq.NOBLOCK)
        except self._zmq.Again:
            return "unread"
        except self._zmq.ZMQError as error:
            if error.errno != errno.EHOSTUNREACH:
                raise
            return "gone"
        return "sent"

    def close(self) -> None:
        """Disconnect all programs."""
        self._socket.close()
        self._context.term()
        self._bell.close()
        self._ringer.close()
        if (file := _IPC.fullmatch(self.address)) is not None:
            with suppress(OSError):
                os.unlink(file[1])


def _check_not_taken(address: str) -> None:
    """Raise OSError if a service listens at a file, which ZeroMQ would take away from it."""
    if (file := _IPC.fullmatch(address)) is None or not hasattr(socket, "AF_UNIX"):
        return
    with socket.socket(socket.AF_UNIX) as probe:
        if probe.connect_ex(file[1]) == 0:
            raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))
    if os.path.lexists(file[1]) and not os.path.islink(file[1]) and os.path.isfile(file[1]):
        raise OSError(errno.EEXIST, "it is a file")


def _reason(error: OSError) -> str:
    """Why it failed, without the address that ZeroMQ adds."""
    return str(error.strerror).partition(" (addr")[0]


def _allow_connections() -> None:
    """Raise the number of files that the process may open, as each connection is one."""
    with suppress(ImportError, ValueError, OSError):
        import resource

        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        wanted = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(_OPEN_FILES, hard)
        if soft != resource.RLIM_INFINITY and soft < wanted:
            resource.setrlimit(resource.RLIMIT_NOFILE, (wanted, hard))
