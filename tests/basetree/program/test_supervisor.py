"""What a supervisor such as systemd is told."""

import os
import socket
import sys
from pathlib import Path

import pytest

from basetree.program.supervisor import Supervisor

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such sockets")


@pytest.fixture
def listener(tmp_path: Path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as one:
        one.bind(str(tmp_path / "notify"))
        one.settimeout(5)
        yield one


def test_each_message_is_a_line(listener: socket.socket, tmp_path: Path) -> None:
    supervisor = Supervisor({"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "2500000"})
    assert supervisor.watchdog_s == 2.5
    supervisor.ready()
    supervisor.status("camera lost:\nno answer")
    supervisor.alive()
    supervisor.stopping()
    lines = [listener.recv(4096).decode() for _ in range(4)]
    assert lines == ["READY=1", "STATUS=camera lost: no answer", "WATCHDOG=1", "STOPPING=1"]


@pytest.mark.skipif(sys.platform != "linux", reason="Linux alone has abstract sockets")
def test_an_abstract_socket_is_found() -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as one:
        one.bind(f"\0edgetree-test-{os.getpid()}")
        one.settimeout(5)
        Supervisor({"NOTIFY_SOCKET": f"@edgetree-test-{os.getpid()}"}).ready()
        assert one.recv(4096) == b"READY=1"


@pytest.mark.parametrize(
    "given",
    [
        {},
        {"NOTIFY_SOCKET": ""},
        {"NOTIFY_SOCKET": "relative"},
        {"NOTIFY_SOCKET": "/no/such/socket"},
        {"NOTIFY_SOCKET": "vsock:2:1"},
    ],
)
def test_without_a_supervisor_nothing_happens(given: dict[str, str]) -> None:
    supervisor = Supervisor(given)
    supervisor.ready()
    supervisor.status("running")
    supervisor.alive()
    supervisor.stopping()


@pytest.mark.parametrize(
    ("given", "watchdog_s"),
    [
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": str(os.getpid())}, 3.0),
        ({"WATCHDOG_USEC": "3000000", "WATCHDOG_PID": "1"}, None),
        ({"WATCHDOG_USEC": "0"}, None),
        ({"WATCHDOG_USEC": "soon"}, None),
        ({}, None),
    ],
)
def test_the_watchdog_is_that_of_this_process(
    given: dict[str, str], watchdog_s: float | None
) -> None:
    assert Supervisor({"NOTIFY_SOCKET": "/x", **given}).watchdog_s == watchdog_s


def test_a_supervisor_that_reads_nothing_stops_nobody(
    listener: socket.socket, tmp_path: Path
) -> None:
    supervisor = Supervisor({"NOTIFY_SOCKET": str(tmp_path / "notify")})
    for _ in range(2000):
        supervisor.ready()
