"""`edgetree live` as a service, with camera, broker and clients that are killed at random.

python -m benchmarks.live_service --minutes 60 --result benchmarks/results/live_service.json

A process of its own plays the camera: it serves the package's sample pictures as MJPEG over HTTP.
The service reads it, and sends its stems by UDP, by MQTT (if a mosquitto is installed) and into a
file, by a set-up file. At random moments the camera or the broker is killed (SIGKILL) and started
again 2 s later; clients of the page come, never read, and leave. They come once before the clock
starts, as the first ones cost what the page keeps (`first_clients_mib`). Recorded are the results,
gaps in the numbers of datagrams, the silence after each kill, memory and open files of the service,
and its states. The exit code is 1 if the service ended, memory grew, or results are missing in the
file. Needs Linux, for /proc.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2

from benchmarks.tools.processes import PROC, memory_mib
from benchmarks.tools.program import finish, machine, note, program
from edgetree import sample_frames

MEMORY_LIMIT_MIB = 8.0
DOWN_S = 2.0
SETTLED_S = 6.0  # until clients that do not read are disconnected
STATE_SCHEMA = "edgetree.live.state/1"


def play(port: int, rate_hz: float) -> None:
    """The process of the camera."""
    pictures = [cv2.imencode(".jpg", frame.image())[1].tobytes() for frame in sample_frames()]

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            number = 0
            with suppress(OSError):
                while True:
                    jpeg = pictures[number % len(pictures)]
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}"
                    self.wfile.write(head.encode() + b"\r\n\r\n" + jpeg + b"\r\n")
                    number += 1
                    time.sleep(1 / rate_hz)

        def log_message(self, *_: Any) -> None:
            """Say nothing."""

    ThreadingHTTPServer(("127.0.0.1", port), Handler).serve_forever()


class Controller(threading.Thread):
    """Receives the datagrams of the service."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port: int = self.socket.getsockname()[1]
        self.arrivals_s: list[float] = []
        self.states: list[tuple[float, str]] = []
        self.gaps = 0
        self._sequence = 0

    def run(self) -> None:
        """Take datagrams for ever."""
        while True:
            message, now_s = json.loads(self.socket.recv(65_536)), time.monotonic()
            self.gaps += message["sequence"] - self._sequence - 1
            self._sequence = message["sequence"]
            if message["schema"] != STATE_SCHEMA:
                self.arrivals_s.append(now_s)
            elif not self.states or self.states[-1][1] != message["state"]:
                self.states.append((now_s, message["state"]))

    def silence_s(self, since_s: float, until_s: float) -> float:
        """The longest time without stems in a span."""
        times = [since_s, *(t for t in self.arrivals_s if since_s < t < until_s), until_s]
        return max(after - before for before, after in pairwise(times))


class Others:
    """Camera, broker and clients, which are killed and come back."""

    def __init__(self, folder: Path, ports: dict[str, int], rate_hz: float) -> None:
        self._folder, self._ports, self._rate_hz = folder, ports, rate_hz
        self.mosquitto = shutil.which("mosquitto")
        self._clients: list[socket.socket] = []
        self._camera: Any = None
        self._broker: subprocess.Popen[bytes] | None = None
        for name in ("camera", "broker"):
            self.start(name)

    def start(self, name: str) -> None:
        """Start the camera or the broker."""
        if name == "camera":
            arguments = (self._ports["camera"], self._rate_hz)
            context = multiprocessing.get_context("spawn")
            self._camera = context.Process(target=play, args=arguments, daemon=True)
            self._camera.start()
        elif self.mosquitto is not None:
            words = [self.mosquitto, "-p", str(self._ports["broker"])]
            self._broker = subprocess.Popen(words, stderr=subprocess.DEVNULL)

    def kill(self, name: str) -> None:
        """Kill one; or clients come, one that never reads and 40 of which half leave at once."""
        if name == "camera":
            self._camera.kill()
            self._camera.join()
        elif name == "broker" and self._broker is not None:
            # The real program stands behind a shell where the installation has one.
            self._broker.kill()
            self._broker.wait()
        elif name == "clients":
            self._visit()

    def _visit(self) -> None:
        for client in self._clients[20:]:
            client.close()
        self._clients = self._clients[:20]
        for number in range(40):
            with suppress(OSError):
                client = socket.create_connection(("127.0.0.1", self._ports["page"]), timeout=5)
                path = ("/picture.mjpeg", "/events", "/stems.json", "/")[number % 4]
                client.sendall(f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
                self._clients.append(client)

    def close(self) -> None:
        """End them all."""
        for name in ("camera", "broker"):
            self.kill(name)
        for client in self._clients:
            client.close()


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def started(folder: Path, ports: dict[str, int], udp: int, mqtt: bool) -> subprocess.Popen[str]:
    """The service, by a set-up file."""
    values: dict[str, Any] = {"source": f"http://127.0.0.1:{ports['camera']}/", "model": "rgb"}
    values |= {"page": True, "port": ports["page"], "udp": f"127.0.0.1:{udp}", "threads": 1}
    values |= {"jsonl": str(folder / "trees.jsonl")}
    values |= {"mqtt": f"127.0.0.1:{ports['broker']}"} if mqtt else {}
    text = "".join(f"{name} = {json.dumps(value)}\n" for name, value in values.items())
    (folder / "edgetree.toml").write_text(text)
    words = [sys.executable, "-m", "edgetree", "live", "--config", str(folder / "edgetree.toml")]
    log = (folder / "log").open("w")
    return subprocess.Popen(words, stderr=log, text=True)


def wait_for_camera(port: int) -> None:
    """Wait until the camera listens."""
    while True:
        with socket.socket() as one:
            if one.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)


def cost_of_clients(service: int, others: Others) -> float:
    """What the first clients of the page add to the memory of the service, MiB."""
    time.sleep(SETTLED_S)
    before_mib = memory_mib(service, "status", "VmRSS")
    others.kill("clients")
    time.sleep(SETTLED_S)
    return round(memory_mib(service, "status", "VmRSS") - before_mib, 2)


def run(arguments: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Run the service for the given time."""
    chance = random.Random(arguments.seed)
    ports = {name: free_port() for name in ("camera", "page", "broker")}
    controller = Controller()
    controller.start()
    others = Others(folder, ports, arguments.rate)
    wait_for_camera(ports["camera"])
    has_broker = others.mosquitto is not None
    service = started(folder, ports, controller.port, has_broker)
    while not controller.arrivals_s and service.poll() is None:
        time.sleep(0.1)
    first_clients_mib = cost_of_clients(service.pid, others)
    start_s, duration_s = time.monotonic(), arguments.minutes * 60.0
    kinds = ["camera", *(["broker"] if has_broker else []), "clients"]
    kills = sorted(
        (chance.uniform(0.05, 0.95) * duration_s, kinds[number % len(kinds)])
        for number in range(arguments.kills * len(kinds))
    )
    restarts: list[tuple[float, str]] = []
    killed: list[tuple[float, str]] = []
    memory_mib_by_s: list[float] = []
    files: list[int] = []
    try:
        while (now_s := time.monotonic() - start_s) < duration_s and service.poll() is None:
            while kills and kills[0][0] <= now_s:
                _, name = kills.pop(0)
                if any(each == name for _, each in restarts):
                    continue
                others.kill(name)
                killed.append((now_s, name))
                if name != "clients":
                    restarts.append((now_s + DOWN_S, name))
            for due in [each for each in restarts if each[0] <= now_s]:
                others.start(due[1])
                restarts.remove(due)
            memory_mib_by_s.append(memory_mib(service.pid, "status", "VmRSS"))
            files.append(len(os.listdir(PROC / str(service.pid) / "fd")))
            time.sleep(1.0)
        ended = service.poll()
        service.send_signal(signal.SIGTERM)
        code = service.wait(30)
    finally:
        others.close()
        service.kill()
    log = (folder / "log").read_text("utf-8", "replace").splitlines()
    return {
        "machine": machine(),
        "seconds": round(duration_s),
        "rate_hz": arguments.rate,
        "broker": "mosquitto" if has_broker else None,
        **counted(folder, controller, killed, start_s),
        "first_clients_mib": first_clients_mib,
        **growth(memory_mib_by_s, files),
        "states": [[round(at_s - start_s, 1), name] for at_s, name in controller.states],
        "lines_on_stderr": len([line for line in log if not line.startswith("running: ")]),
        "tracebacks": sum("Traceback" in line for line in log),
        "ended_by_itself": ended is not None,
        "exit_code": code,
    }


def counted(
    folder: Path, controller: Controller, killed: list[tuple[float, str]], start_s: float
) -> dict[str, Any]:
    """Results, gaps and silences."""
    records = [json.loads(line) for line in (folder / "trees.jsonl").read_text().splitlines()]
    written = sum(record["schema"] == "edgetree.live/1" for record in records)
    silences: dict[str, list[float]] = {}
    for at_s, name in killed:
        since_s = start_s + at_s
        silence_s = controller.silence_s(since_s, since_s + 15.0)
        silences.setdefault(name, []).append(round(silence_s, 2))
    return {
        "results": len(controller.arrivals_s),
        "results_in_file": written,
        "datagrams_missing": controller.gaps,
        "kills": [[round(at_s, 1), name] for at_s, name in killed],
        "longest_silence_after_kill_s": silences,
    }


def growth(memory: list[float], files: list[int]) -> dict[str, Any]:
    """Memory and open files, from the second tenth of the run to the last."""
    tenth = max(len(memory) // 10, 1)
    grown_mib = sum(memory[-tenth:]) / tenth - sum(memory[tenth : 2 * tenth]) / tenth
    return {
        "memory_mib": [round(value, 1) for value in memory[:: max(len(memory) // 60, 1)]],
        "growth_mib": round(grown_mib, 2),
        "limit_mib": MEMORY_LIMIT_MIB,
        "open_files": [min(files), files[-1], max(files)],
    }


def main() -> None:
    """Run the test."""
    parser = program(__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=5.0, help="frames per second of the camera")
    parser.add_argument("--kills", type=int, default=10, help="kills of each kind")
    parser.add_argument("--seed", type=int, default=1000)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        result = run(arguments, Path(folder))
    passed = (
        not result["ended_by_itself"]
        and result["exit_code"] == 128 + signal.SIGTERM
        and result["results"] + result["datagrams_missing"] >= result["results_in_file"]
        and abs(result["results"] - result["results_in_file"]) <= result["datagrams_missing"] + 1
        and result["growth_mib"] <= MEMORY_LIMIT_MIB
        and not result["tracebacks"]
    )
    note("passed" if passed else "failed")
    finish({**result, "passed": passed}, arguments.result)
    sys.exit(0 if passed else 1)


if __name__ == "__main__":
    main()
