"""How long a frame takes from another program into the service of `edgetree live --serve`.

python -m benchmarks.serve --result benchmarks/results/serve.json

A program of its own hands over pairs of 1280x720 px, colour in BGR and depth in 16 bits, the
next one 1/30 s after an answer. A crossing begins with the arrays in that program and ends with
equal arrays in the service, ready for the pipeline. The answer takes as long as a short text. The
ways take turns, in rounds.
`busy` is the load of the machine's processors by others meanwhile, 1 for one of them.
"""

from __future__ import annotations

import multiprocessing
import os
import statistics
import tempfile
import time
from typing import Any, Final

import numpy as np

from benchmarks.tools.program import finish, machine, note, program
from edgetree.frames.frame import stream_frame
from edgetree.serve import Client, Service
from edgetree.serve.messages import FrameMessage

WIDTH, HEIGHT = 1280, 720
EVERY_S: Final = 1 / 30
WARM_UP: Final = 10
WAYS: Final = {
    "shared memory, tcp": ("tcp://127.0.0.1:0", True),
    "shared memory, ipc": ("ipc://{folder}/service", True),
    "parts of the message, tcp": ("tcp://127.0.0.1:0", False),
    "parts of the message, ipc": ("ipc://{folder}/service", False),
}


def hand_over(address: str, shared_memory: bool, count: int) -> None:
    """The other program: pairs with the time of their beginning as time stamp."""
    rng = np.random.default_rng(0)
    colour = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    depth = rng.integers(0, 20_000, (HEIGHT, WIDTH), np.uint16)
    with Client(address, shared_memory=shared_memory, timeout_s=60.0) as client:
        for _ in range(count):
            client.send_arrays(FrameMessage(0, time.monotonic()), colour, depth)
            client.receive()
            time.sleep(EVERY_S)


def crossings_ms(address: str, shared_memory: bool, count: int) -> list[float]:
    """Times of crossings of one way."""
    found: list[float] = []
    with Service(address) as service:
        source = service.open_source()
        arguments = (service.address, shared_memory, count)
        other = multiprocessing.get_context("spawn").Process(target=hand_over, args=arguments)
        other.start()
        for handed in source.handed():
            found.append((time.monotonic() - handed.message.time_s) * 1000)
            assert handed.colour is not None
            assert handed.depth is not None
            service.unused(stream_frame(handed.number, 0.0, None), "measured")
            if len(found) == count:
                break
        other.join()
    return found[WARM_UP:]


def figures(times_ms: list[float]) -> dict[str, float]:
    """Median, 95 of 100, and fastest."""
    p95 = float(np.percentile(times_ms, 95))
    values = {"median": statistics.median(times_ms), "p95": p95, "fastest": min(times_ms)}
    return {f"{name}_ms": round(value, 2) for name, value in values.items()}


def busy(since: tuple[float, float, float]) -> float:
    """Processors that other programs used since a time."""
    wall_s, idle_s, own_s = (now - then for now, then in zip(clocks(), since, strict=True))
    return round(max(0.0, (os.cpu_count() or 1) - (idle_s + own_s) / wall_s), 2)


def clocks() -> tuple[float, float, float]:
    """Seconds of the clock, of all idle processors, and of this program and those it has ended."""
    with open("/proc/stat", encoding="ascii") as file:
        fields = file.readline().split()
    times = os.times()
    own_s = times.user + times.system + times.children_user + times.children_system
    return time.monotonic(), (int(fields[4]) + int(fields[5])) / os.sysconf("SC_CLK_TCK"), own_s


def main() -> None:
    """Measure all ways."""
    parser = program(__doc__)
    parser.add_argument("--frames", type=int, default=100, help="frames of a way in a round")
    parser.add_argument("--rounds", type=int, default=3)
    options = parser.parse_args()
    times_ms: dict[str, list[float]] = {way: [] for way in WAYS}
    began = clocks()
    with tempfile.TemporaryDirectory() as folder:
        for number in range(options.rounds):
            for way, (address, shared_memory) in WAYS.items():
                where = address.format(folder=folder)
                times_ms[way] += crossings_ms(where, shared_memory, options.frames + WARM_UP)
                note(f"round {number + 1}, {way}: {figures(times_ms[way])}")
    result: dict[str, Any] = {
        "machine": machine(),
        "processors": os.cpu_count(),
        "busy": busy(began),
        "frames": options.frames * options.rounds,
        "pair_bytes": WIDTH * HEIGHT * 5,
        "ways": {way: figures(times) for way, times in times_ms.items()},
    }
    finish(result, options.result)


if __name__ == "__main__":
    main()
