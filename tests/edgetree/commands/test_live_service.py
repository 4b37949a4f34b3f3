"""`edgetree live` as a service: started by its unit's command, watched, killed, started again."""

from __future__ import annotations

import configparser
import json
import os
import shlex
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mqtt_broker import Broker

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such sockets")

UNIT = Path(__file__).resolve().parents[3] / "deploy" / "edgetree.service"
PATIENCE_S = 60.0


class Manager:
    """Starts the unit's command as systemd does, and keeps what it is told."""

    def __init__(self, folder: Path) -> None:
        self.lines: list[str] = []
        self._folder = folder
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind(str(folder / "notify"))
        self._socket.setblocking(False)
        self.process: subprocess.Popen[str] | None = None
        parser = configparser.ConfigParser(interpolation=None)
        parser.optionxform = str
        parser.read(UNIT)
        program, *self._words = shlex.split(parser["Service"]["ExecStart"])
        assert Path(program).name == "edgetree"

    def start(self, setup: Path) -> None:
        """Start the service with another set-up file."""
        self.lines.clear()
        words = [str(setup) if word.endswith(".toml") else word for word in self._words]
        variables = {"NOTIFY_SOCKET": str(self._folder / "notify"), "WATCHDOG_USEC": "2000000"}
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from edgetree.cli import main; main()", *words],
            env=os.environ | variables,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )

    def heard(self, line: str) -> bool:
        """Whether a line has come."""
        while True:
            try:
                self.lines.append(self._socket.recv(4096).decode())
            except BlockingIOError:
                return line in self.lines

    def wait(self, happened: Callable[[], object]) -> None:
        """Wait until something is true, while the process runs."""
        end_s = time.monotonic() + PATIENCE_S
        assert self.process is not None
        while not happened():
            self.heard("")
            assert self.process.poll() is None, self.process.communicate()[1]
            assert time.monotonic() < end_s, self.lines
            time.sleep(0.02)

    def end(self, number: int) -> tuple[int, str]:
        """Send a signal; returns exit code and what was said."""
        assert self.process is not None
        self.process.send_signal(number)
        said = self.process.communicate(timeout=PATIENCE_S)[1]
        return self.process.returncode, said

    def close(self) -> None:
        """End everything."""
        if self.process is not None and self.process.poll() is None:
            self.process.kill()
            self.process.communicate()
        self._socket.close()


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    one = Manager(tmp_path)
    yield one
    one.close()


def free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


@pytest.fixture
def setup(images: Path, model: Path, tmp_path: Path) -> Callable[..., Path]:
    """A function that writes a set-up file of a recording that is played like a camera."""

    def write(**more: object) -> Path:
        values: dict[str, object] = {
            "source": str(images),
            "depth": str(images.parent / "depth"),
            "loop": True,
            "camera": str(images.parent / "camera.json"),
            "model": str(model),
            "as-live": True,
            "jsonl": str(tmp_path / "trees.jsonl"),
            "threads": 1,
            **more,
        }
        path = tmp_path / "setup.toml"
        path.write_text("".join(f"{key} = {json.dumps(value)}\n" for key, value in values.items()))
        return path

    return write


def get(port: int, path: str) -> tuple[int, bytes]:
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=10) as answer:
            return answer.status, answer.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def test_the_unit_starts_a_service_that_is_watched_killed_and_started_again(
    manager: Manager, setup: Callable[..., Path], tmp_path: Path
) -> None:
    port = free_port()
    path = setup(page=True, port=port)
    manager.start(path)
    manager.wait(lambda: manager.heard("READY=1"))
    manager.wait(lambda: manager.heard("STATUS=running"))
    manager.wait(lambda: manager.lines.count("WATCHDOG=1") > 2)
    status, content = get(port, "/readyz")
    assert (status, json.loads(content)["state"]) == (200, "running")
    assert json.loads(get(port, "/version")[1])["name"] == "edgetree"
    assert manager.end(signal.SIGKILL)[0] == -signal.SIGKILL
    manager.start(path)
    manager.wait(lambda: manager.heard("STATUS=running"))
    code, said = manager.end(signal.SIGTERM)
    assert code == 143
    assert "interrupted" in said
    manager.heard("")
    assert manager.lines[-2:] == ["STOPPING=1", "STATUS=stopping"]
    states = [
        record["state"]
        for record in map(json.loads, (tmp_path / "trees.jsonl").read_text().splitlines())
        if record["schema"] == "edgetree.live.state/1"
    ]
    assert states == ["starting", "running", "stopping"]
    assert (tmp_path / "trees.1.jsonl").exists()


def test_a_service_is_scraped_by_prometheus(manager: Manager, setup: Callable[..., Path]) -> None:
    parser = pytest.importorskip("prometheus_client.parser")
    port = free_port()
    manager.start(setup(page=True, port=port))
    manager.wait(lambda: manager.heard("STATUS=running"))
    families = list(parser.text_string_to_metric_families(get(port, "/metrics")[1].decode()))
    samples = {sample.name: sample.value for each in families for sample in each.samples}
    assert samples["edgetree_frames_total"] >= 1
    assert "edgetree_output_missing_total" in samples


def test_a_stopped_process_is_not_alive_for_its_watchdog(
    manager: Manager, setup: Callable[..., Path]
) -> None:
    manager.start(setup())
    manager.wait(lambda: manager.heard("WATCHDOG=1"))
    assert manager.process is not None
    manager.process.send_signal(signal.SIGSTOP)
    time.sleep(0.3)
    manager.heard("")
    manager.lines.clear()
    time.sleep(1.0)
    assert not manager.heard("WATCHDOG=1")
    manager.process.send_signal(signal.SIGCONT)
    manager.wait(lambda: manager.heard("WATCHDOG=1"))


@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        ({"threads": 0}, 2, "line 8: threads is 0: expected at least 1"),
        ({"source": "/no/such.mcap"}, 2, "/no/such.mcap"),
        ({"source": "/dev/video97", "depth": None, "loop": None, "as-live": None}, 1, "camera 97"),
        ({"udp": "no-such-machine.invalid:9000"}, 1, "no-such-machine"),
    ],
)
def test_the_exit_code_tells_a_wrong_set_up_from_what_may_pass(
    manager: Manager, setup: Callable[..., Path], more: dict[str, Any], code: int, words: str
) -> None:
    path = setup(**more)
    lines = [line for line in path.read_text().splitlines() if not line.endswith(" = null")]
    path.write_text("\n".join(lines))
    manager.start(path)
    assert manager.process is not None
    said = manager.process.communicate(timeout=PATIENCE_S)[1]
    assert manager.process.returncode == code, said
    assert said.count("\n") == 1, said
    assert words in said
    assert not manager.heard("STATUS=running")


def test_faults_of_others_stop_nothing(
    manager: Manager, setup: Callable[..., Path], tmp_path: Path
) -> None:
    """The port is taken, the broker goes and comes back, clients never read."""
    pytest.importorskip("paho")
    broker, listener = Broker(), socket.create_server(("127.0.0.1", 0))
    port = listener.getsockname()[1]
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    receiver.bind(("127.0.0.1", 0))
    receiver.settimeout(20)
    lines = tmp_path / "trees.jsonl"
    udp = f"127.0.0.1:{receiver.getsockname()[1]}"
    manager.start(setup(page=True, port=port, mqtt=f"127.0.0.1:{broker.port}", udp=udp))
    try:
        manager.wait(lambda: manager.heard("STATUS=running"))
        broker.wait(lambda: len(broker.of("edgetree/stems")) > 2)
        listener.close()  # the page appears where it should be
        manager.wait(lambda: not refused(port))
        idle = [socket.create_connection(("127.0.0.1", port)) for _ in range(100)]
        idle[-1].sendall(b"GET /picture.mjpeg HTTP/1.1\r\nHost: localhost\r\n\r\n")
        broker.close()
        before = len(lines.read_bytes())
        manager.wait(lambda: len(lines.read_bytes()) > before + 5000)
        again = Broker(broker.port)
        again.wait(lambda: again.of("edgetree/state") and again.of("edgetree/stems"))
        assert json.loads(again.of("edgetree/state")[0].content)["state"] == "running"
        assert get(port, "/readyz")[0] == 200
        numbers = [json.loads(receiver.recv(65536))["sequence"] for _ in range(20)]
        assert numbers == list(range(1, 21))
        code, said = manager.end(signal.SIGTERM)
        assert code == 143
        again.wait(
            lambda: json.loads(again.of("edgetree/state")[-1].content)["state"] == "stopping"
        )
        again.close()
        for words in ("it is tried again every", "is gone", "is back"):
            assert sum(words in line for line in said.splitlines()) == 1, said
        for each in idle:
            each.close()
    finally:
        receiver.close()


def refused(port: int) -> bool:
    with socket.socket() as one:
        return one.connect_ex(("127.0.0.1", port)) != 0
