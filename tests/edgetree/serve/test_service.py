"""The service for other programs: what they get, and that none of them harms the others."""

from __future__ import annotations

import contextlib
import json
import logging
import os
import socket
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from basetree.errors import InputError, Unavailable
from edgetree.errors import ServiceError
from edgetree.frames.frame import Frame
from edgetree.frames.pipeline import process
from edgetree.frames.rig import Rig
from edgetree.live.pipeline import LivePipeline
from edgetree.runtime.detector import TreeDetector
from edgetree.serve import Client, Service
from edgetree.serve.messages import ErrorAnswer, FrameMessage, ResultAnswer, UnusedAnswer
from edgetree.serve.shared_memory import FOLDER, IS_THERE, Slot, remove_left_behind
from edgetree.sources import PushedFrames

zmq = pytest.importorskip("zmq")

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 20.0
FRAME = {"schema": "edgetree.serve.frame/1", "id": 1, "time_s": 0.0}
SMALL = {"width": 4, "height": 2}
needs_memory = pytest.mark.skipif(not IS_THERE, reason="shared memory is used on Linux alone")

MakeFrame = Callable[..., Frame]


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE_S
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def memories() -> set[str]:
    return {path.name for path in FOLDER.glob("edgetree-*")} if IS_THERE else set()


def measured_or_none(client: Client, frame: Frame) -> dict[str, Any] | None:
    with contextlib.suppress(ServiceError):
        return client.measure(frame)
    return None


def told(dealer: Any, *parts: bytes) -> dict[str, Any]:
    """The answer to a message of any parts."""
    dealer.send_multipart(parts)
    return json.loads(dealer.recv_multipart()[-1])


@pytest.mark.parametrize("shared_memory", [False, pytest.param(True, marks=needs_memory)])
def test_metres_are_those_of_the_same_frame_here(
    running: Any, detector: TreeDetector, make_frame: MakeFrame, shared_memory: bool
) -> None:
    frame = make_frame(3)
    here = process(frame, detector, Rig())
    with Client(running.service.address, shared_memory=shared_memory) as client:
        there = client.measure(frame)
    assert here.measurements is not None
    assert there["schema"] == "edgetree.live/1"
    assert [tree["metres"] for tree in there["trees"]] == json.loads(
        json.dumps([tree.to_dict() for tree in here.measurements])
    )
    assert there["trees"][0]["metres"]["distance_m"] == pytest.approx(4.68, abs=0.1)


def test_all_that_a_frame_has_arrives(running: Any, client: Client, make_frame: MakeFrame) -> None:
    frame = make_frame(7)
    client.measure(frame)
    arrived = running.results[0].frame
    assert (arrived.image == frame.image).all()
    assert (arrived.depth_m == frame.depth_m).all()
    assert (arrived.camera, arrived.time_s) == (frame.camera, 0.7)
    assert arrived.up_camera == pytest.approx(frame.up_camera)
    assert arrived.pose.translation_m == pytest.approx([0.7, 0.0, 1.5])


def test_each_frame_gets_one_answer_however_fast_they_come(
    running: Any, client: Client, make_frame: MakeFrame
) -> None:
    ids = [client.send(make_frame(number)) for number in range(30)]
    answers = [client.receive() for _ in ids]
    assert sorted(answer.id for answer in answers) == ids
    unused = [answer for answer in answers if isinstance(answer, UnusedAnswer)]
    assert {answer.reason for answer in unused} <= {"a newer frame had arrived"}
    assert isinstance(answers[-1], ResultAnswer)
    assert len(running.results) == 30 - len(unused)


def test_answers_that_come_while_another_is_waited_for_are_kept(
    running: Any, client: Client, make_frame: MakeFrame
) -> None:
    sent = client.send(make_frame(0))
    client.measure(make_frame(1))
    client.status()
    assert client.receive(1.0).id == sent


def test_answers_that_come_too_late_are_passed_over(make_frame: MakeFrame) -> None:
    with Service("tcp://127.0.0.1:0") as service, Client(service.address, timeout_s=0.2) as client:
        with pytest.raises(ServiceError, match="does not answer"):
            client.measure(make_frame())
        sent = client.send(make_frame(1))
        wait_until(lambda: 1 in service._place._asked)
        service.close()
        assert client.receive(PATIENCE_S).id == sent
        with pytest.raises(ServiceError, match="does not answer"):
            client.receive(0.2)


def test_frames_that_wait_are_answered_when_the_service_ends(make_frame: MakeFrame) -> None:
    with (
        Service("tcp://127.0.0.1:0") as service,
        Client(service.address, timeout_s=PATIENCE_S) as client,
    ):
        client.send(make_frame())
        wait_until(lambda: bool(service._place._asked))
        service.close()
        answer = client.receive()
    assert isinstance(answer, UnusedAnswer)
    assert answer.reason == "the service ends"


def test_a_frame_without_what_the_model_takes_is_answered_with_the_reason(
    client: Client, make_frame: MakeFrame
) -> None:
    with pytest.raises(ServiceError, match="left out: without colour, which the model takes"):
        client.measure(make_frame(image=None))


def test_a_request_socket_gets_its_answer_too(running: Any) -> None:
    with zmq.Context() as context, context.socket(zmq.REQ) as plain:
        plain.setsockopt(zmq.LINGER, 0)
        plain.setsockopt(zmq.RCVTIMEO, 20_000)
        plain.connect(running.service.address)
        plain.send_json({"schema": "edgetree.serve.ask/1"})
        assert plain.recv_json()["state"] == "starting"


def test_others_watch_the_results(running: Any, client: Client, make_frame: MakeFrame) -> None:
    seen: list[dict[str, Any]] = []

    def watch() -> None:
        with Client(running.service.address) as watcher:
            for record in watcher.watch():
                seen.append(record)
                return

    watching = threading.Thread(target=watch)
    watching.start()
    while watching.is_alive():
        last = client.measure(make_frame())
        watching.join(0.01)
    assert seen[0]["schema"] == "edgetree.live/1"
    assert seen[0]["frame"] <= last["frame"]


def test_frames_are_refused_where_another_source_is_measured(
    detector: TreeDetector, make_frame: MakeFrame
) -> None:
    with (
        Service("tcp://127.0.0.1:0", takes_frames=False) as service,
        Client(service.address, timeout_s=PATIENCE_S) as client,
    ):
        id_ = client.send(make_frame())
        wait_until(lambda: bool(service._faults.counts or service._place._asked))
        # The camera's own frame of the same number, whose result is no answer.
        camera = PushedFrames("a camera")
        camera.push(make_frame(0))
        camera.close()
        (result,) = LivePipeline(lambda: camera, detector)
        service.write(result)
        answer = client.receive()
    assert isinstance(answer, ErrorAnswer)
    assert answer.id == id_
    assert "expected `edgetree live clients`" in answer.error


def test_a_frame_that_nobody_took_does_not_keep_the_place_of_its_program(
    make_frame: MakeFrame,
) -> None:
    with Service("tcp://127.0.0.1:0", silent_s=0.3) as service:
        with Client(service.address, timeout_s=PATIENCE_S) as hasty:
            hasty.send(make_frame())
            wait_until(lambda: bool(service._place._asked))
        wait_until(lambda: service._place.holder is None and not service._place._asked)
        service.open_source().close()  # as a pipeline that ends

        with Client(service.address, timeout_s=PATIENCE_S) as client:
            client.send(make_frame())
            assert isinstance(client.receive(), UnusedAnswer)
            wait_until(lambda: service._place.holder is None)


@needs_memory
def test_memory_that_the_service_may_not_read_is_done_without(
    running: Any, make_frame: MakeFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[str] = []

    def write(slot: Slot, arrays: Any) -> list[int]:
        written.append(slot.name)
        offsets = real_write(slot, arrays)
        (FOLDER / slot.name.removeprefix("/")).unlink()
        return offsets

    real_write = Slot.write
    monkeypatch.setattr(Slot, "write", write)
    with Client(running.service.address, timeout_s=PATIENCE_S) as client:
        assert all(client.measure(make_frame(number))["trees"] for number in range(3))
    assert len(written) == 1


def test_a_killed_watcher_is_forgotten(
    running: Any, client: Client, dealer: Any, make_frame: MakeFrame
) -> None:
    dealer.send(b'{"schema": "edgetree.serve.watch/1"}')
    wait_until(lambda: len(running.service._watchers) == 1)
    dealer.close()
    wait_until(lambda: bool(client.measure(make_frame())) and not running.service._watchers)


def test_one_program_at_a_time_hands_frames_over(
    running: Any, client: Client, make_frame: MakeFrame
) -> None:
    with Client(running.service.address) as first:
        first.measure(make_frame())
        with pytest.raises(ServiceError, match="another program hands frames over"):
            client.measure(make_frame())
    wait_until(lambda: running.pipeline.status.state == "lost")
    assert client.measure(make_frame())["trees"]
    wait_until(lambda: running.pipeline.status.state == "running")
    assert running.pipeline.status.lost == 1


def test_a_dead_program_loses_its_place_at_once(
    serving: Callable[..., Any], make_frame: MakeFrame
) -> None:
    running = serving(silent_s=60.0)
    dead = Client(running.service.address)
    dead.measure(make_frame())
    dead._socket.close(linger=0)  # without goodbye
    with Client(running.service.address, timeout_s=PATIENCE_S) as other:
        wait_until(lambda: bool(measured_or_none(other, make_frame())))


def test_a_stalled_program_loses_its_place_to_another(
    serving: Callable[..., Any], make_frame: MakeFrame, caplog: pytest.LogCaptureFixture
) -> None:
    running = serving(silent_s=0.2)
    with (
        Client(running.service.address) as stalled,
        Client(running.service.address) as other,
    ):
        stalled.measure(make_frame())
        wait_until(lambda: running.pipeline.status.state == "lost")
        assert other.measure(make_frame())["trees"]
    assert "no program has handed a frame over for 0.2 s" in caplog.text


DIES = """
import os, sys
sys.path.insert(0, {folder!r})
import numpy as np
from edgetree.frames.frame import stream_frame
from edgetree.serve import Client
client = Client({address!r}, timeout_s=20)
frame = stream_frame(0, 0.0, np.zeros((360, 640, 3), np.uint8), np.ones((360, 640), np.float32))
client.send(frame)
{then}
os.kill(os.getpid(), 9)
"""


@needs_memory
@pytest.mark.parametrize("then", ["client.receive()", "import time; time.sleep(0.2)"])
def test_a_killed_program_leaves_nothing_behind(
    serving: Callable[..., Any], make_frame: MakeFrame, then: str
) -> None:
    running, before = serving(silent_s=0.2), memories()
    program = DIES.format(folder=str(ROOT), address=running.service.address, then=then)
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], check=False)
    assert done.returncode == -9
    wait_until(lambda: running.pipeline.status.state == "lost")
    assert memories() - before == set()
    with Client(running.service.address, timeout_s=PATIENCE_S) as client:
        assert client.measure(make_frame())["trees"]


@needs_memory
def test_memory_that_no_service_read_is_removed_a_minute_later() -> None:
    old, new = (FOLDER / f"edgetree-test-{os.getpid()}-{name}" for name in ("old", "new"))
    try:
        for path in (old, new):
            path.write_bytes(b"0")
        os.utime(old, (1e9, 1e9))
        assert remove_left_behind() >= 1
        assert (old.exists(), new.exists()) == (False, True)
    finally:
        new.unlink()


NONSENSE = {
    "no text": ([b"\xff\xfe\x00"], "is not JSON"),
    "nothing": ([b""], "is not JSON"),
    "another schema": ([b'{"schema": "edgetree.live/1"}'], "Invalid value 'edgetree.live/1'"),
    "a list": ([b"[1]"], "is a list, expected an object"),
    "endless": ([b'"' * 70_000], "at most 65536 bytes"),
    "no time": ([json.dumps({**FRAME, "time_s": None}).encode()], "time_s"),
    "no image": ([json.dumps(FRAME).encode()], "neither image nor depth"),
    "no pixels": ([json.dumps({**FRAME, "colour": SMALL}).encode()], "0 parts of pixels"),
    "few pixels": (
        [json.dumps({**FRAME, "colour": SMALL}).encode(), b"123"],
        "has 3 bytes: expected 24",
    ),
    "many parts": ([json.dumps(FRAME).encode(), *[b"1"] * 1000], "1000 parts of pixels"),
    "huge": (
        [json.dumps({**FRAME, "colour": {"width": 65535, "height": 65535}}).encode(), b"1"],
        "expected at most 67108864",
    ),
    "another size": (
        [
            json.dumps({**FRAME, "colour": SMALL, "depth": {"width": 2, "height": 2}}).encode(),
            bytes(24),
            bytes(8),
        ],
        "depth of frame",
    ),
    "a mirror": (
        [
            json.dumps(
                {
                    **FRAME,
                    "colour": SMALL,
                    "pose": {
                        "rotation": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]],
                        "translation_m": [0] * 3,
                    },
                }
            ).encode(),
            bytes(24),
        ],
        "right-handed",
    ),
    "another's memory": (
        [
            json.dumps(
                {**FRAME, "colour": {**SMALL, "memory": {"name": "/edgetree-../passwd"}}}
            ).encode()
        ],
        "matching regex",
    ),
    "no memory": (
        [json.dumps({**FRAME, "colour": {**SMALL, "memory": {"name": "/edgetree-none"}}}).encode()],
        "shared memory /edgetree-none cannot be read",
    ),
}


@pytest.mark.parametrize("name", NONSENSE)
def test_nonsense_gets_an_error_and_harms_nobody(
    running: Any, client: Client, dealer: Any, make_frame: MakeFrame, name: str
) -> None:
    parts, expected = NONSENSE[name]
    answer = told(dealer, *parts)
    assert answer["schema"] == "edgetree.serve.error/1"
    assert expected in answer["error"]
    dealer.send(b'{"schema": "edgetree.serve.bye/1"}')
    wait_until(lambda: running.service._place.holder is None)
    assert client.measure(make_frame())["trees"]


def test_nonsense_without_end_is_told_in_few_lines(
    running: Any, client: Client, dealer: Any, caplog: pytest.LogCaptureFixture
) -> None:
    for _ in range(500):
        told(dealer, b"nonsense")
    lines = [record for record in caplog.records if record.levelno >= logging.WARNING]
    assert len(lines) == 1
    assert client.status().faults == {"message that cannot be read": 500}


@pytest.mark.parametrize("text", [b"GET / HTTP/1.1\r\nHost: a\r\n\r\n", bytes(100_000), b"\xff"])
def test_what_is_not_zeromq_harms_nobody(
    running: Any, client: Client, make_frame: MakeFrame, text: bytes
) -> None:
    port = int(running.service.address.rpartition(":")[2])
    with socket.create_connection(("127.0.0.1", port)) as stranger:
        stranger.sendall(text)
        assert client.measure(make_frame())["trees"]


def test_a_message_beyond_the_limit_ends_its_connection_alone(
    client: Client, dealer: Any, make_frame: MakeFrame
) -> None:
    dealer.send_multipart([json.dumps({**FRAME, "colour": SMALL}).encode(), bytes(65 * 2**20)])
    assert client.measure(make_frame())["trees"]
    # It connects again, and the long message was never taken.
    assert told(dealer, b'{"schema": "edgetree.serve.ask/1"}')["faults"] == {}


@needs_memory
def test_memory_that_became_smaller_is_an_error(dealer: Any) -> None:
    name = f"edgetree-test-{os.getpid()}-shrinks"
    (FOLDER / name).write_bytes(bytes(10))
    colour = {**SMALL, "memory": {"name": f"/{name}"}}
    answer = told(dealer, json.dumps({**FRAME, "colour": colour}).encode())
    assert f"shared memory /{name} has 10 bytes from byte 0 on: expected 24" in answer["error"]
    assert not (FOLDER / name).exists()


def test_a_program_that_never_reads_keeps_nobody_waiting(
    running: Any, client: Client, dealer: Any, make_frame: MakeFrame
) -> None:
    dealer.send(b'{"schema": "edgetree.serve.watch/1"}')
    with contextlib.suppress(zmq.Again):  # nothing more is taken from it
        for _ in range(20_000):
            dealer.send(b'{"schema": "edgetree.serve.ask/1"}', zmq.NOBLOCK)
    for number in range(3):
        assert client.measure(make_frame(number))["trees"]


def test_a_thousand_connections(running: Any, client: Client, make_frame: MakeFrame) -> None:
    context = zmq.Context()
    context.set(zmq.MAX_SOCKETS, 1100)
    others = [context.socket(zmq.DEALER) for _ in range(1000)]
    try:
        for other in others:
            other.setsockopt(zmq.LINGER, 0)
            other.setsockopt(zmq.RCVTIMEO, 20_000)
            other.connect(running.service.address)
            other.send(b'{"schema": "edgetree.serve.watch/1"}')
        wait_until(lambda: len(running.service._watchers) == 1000)
        assert client.measure(make_frame())["trees"]
        assert all(b"edgetree.live/1" in other.recv() for other in others)
    finally:
        context.destroy(linger=0)


@pytest.mark.parametrize("form", ["tcp://127.0.0.1:0", "ipc://{folder}/service"])
def test_more_connections_than_there_may_be_are_not_let_in(
    serving: Callable[..., Any],
    make_frame: MakeFrame,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    form: str,
) -> None:
    monkeypatch.setattr("edgetree.serve.router.most_connections", lambda: 20)
    address = serving(form.format(folder=tmp_path)).service.address
    ask = b'{"schema": "edgetree.serve.ask/1"}'
    context = zmq.Context()
    try:
        with Client(address, timeout_s=PATIENCE_S) as client:
            assert client.measure(make_frame())["trees"]
            others = [context.socket(zmq.DEALER) for _ in range(30)]
            for other in others:
                other.connect(address)
                other.send(ask)
            # One of those too many may be answered before it is turned away.
            wait_until(lambda: sum(bool(other.poll(0)) for other in others) >= 19)
            wait_until(lambda: "20 programs are connected: expected no more" in caplog.text)
            assert client.measure(make_frame(1))["trees"]  # those inside go on
            wait_until(lambda: client.status().faults["program too many"] >= 11)
            late = [other for other in others if not other.poll(0)]
            for other in set(others) - set(late):
                other.close(linger=0)

            # Those that were turned away come again by themselves; what they had said is lost.
            def all_hear() -> bool:
                for other in late:
                    other.send(ask, zmq.NOBLOCK)
                return all(other.poll(20) for other in late)

            wait_until(all_hear)
    finally:
        context.destroy(linger=0)
    assert len([line for line in caplog.messages if "it is turned away" in line]) <= 3


@pytest.mark.parametrize("shared_memory", [False, pytest.param(True, marks=needs_memory)])
def test_a_program_outlives_the_service(
    serving: Callable[..., Any], make_frame: MakeFrame, tmp_path: Path, shared_memory: bool
) -> None:
    address = f"ipc://{tmp_path}/service"
    first = serving(address)
    with Client(address, timeout_s=PATIENCE_S, shared_memory=shared_memory) as client:
        client.measure(make_frame())
        first.pipeline.stop()
        first.service.close()
        serving(address)
        assert client.measure(make_frame())["trees"]


@pytest.mark.parametrize(
    "address", ["tcp://0.0.0.0:8430", "8430", "tcp://127.0.0.1:99999", "ipc://", "inproc://a"]
)
def test_other_addresses_are_refused(address: str) -> None:
    with pytest.raises(InputError, match=r"expected tcp://127\.0\.0\.1:PORT or ipc://FILE"):
        Service(address)


@pytest.mark.parametrize("form", ["tcp://127.0.0.1:0", "ipc://{folder}/service"])
def test_a_taken_address_is_refused(
    serving: Callable[..., Any], make_frame: MakeFrame, tmp_path: Path, form: str
) -> None:
    address = serving(form.format(folder=tmp_path)).service.address
    with pytest.raises(Unavailable, match=r"cannot listen at .* \(Address already in use\)"):
        Service(address)
    with Client(address) as client:
        assert client.measure(make_frame())["trees"]


def test_a_name_that_is_too_long_is_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot listen at .* \(.*too long\)"):
        Service(f"ipc://{tmp_path}/{'a' * 120}")


def test_no_service_is_one_error() -> None:
    with (
        Client("tcp://127.0.0.1:1", timeout_s=0.05) as client,
        pytest.raises(ServiceError, match=r"at tcp://127.0.0.1:1 does not answer within 0.05 s"),
    ):
        client.status()


def test_a_frame_that_cannot_be_used_is_no_fault_of_the_others(
    running: Any, client: Client, make_frame: MakeFrame
) -> None:
    client.measure(make_frame())
    image = make_frame().image
    for time_s in (float("inf"), 1e300, -1e300, 1.7e12):
        client.send_arrays(FrameMessage(0, time_s), image, None)
        answer = client.receive()
        assert isinstance(answer, ErrorAnswer)
        assert "time_s" in answer.error
    assert client.measure(make_frame())["trees"]
    assert not isinstance(client.status(), ErrorAnswer)
