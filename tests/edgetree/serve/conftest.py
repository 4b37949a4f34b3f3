"""A service with a pipeline whose network is made up, and raw sockets that do anything."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

import numpy as np
import pytest

from calib import PinholeCamera, RigidTransform
from edgetree.frames.frame import Frame, stream_frame
from edgetree.live.pipeline import LivePipeline
from edgetree.model_file.manifest import Manifest
from edgetree.runtime.detector import TreeDetector
from edgetree.runtime.session import FakeSession
from edgetree.serve import Client, Service

CAMERA = PinholeCamera(640, 360, 400.0, 400.0, 319.5, 179.5)


class Running(NamedTuple):
    """A service, its pipeline and the results that it sent."""

    service: Service
    pipeline: LivePipeline
    results: list[Any]


def _frame(number: int = 0, **changes: Any) -> Frame:
    depth_m = np.tile(np.linspace(3.9, 4.1, 640, dtype=np.float32), (360, 1))
    values = {
        "image": np.full((360, 640, 3), number, np.uint8),
        "depth_m": depth_m,
        "camera": CAMERA,
        "up_camera": np.array([0.0, -1.0, 0.0]),
        "pose": RigidTransform(
            np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.array([number / 10, 0.0, 1.5])
        ),
    }
    return stream_frame(number, number / 10, **(values | changes))


@pytest.fixture
def make_frame() -> Callable[..., Frame]:
    """A function that makes the frame of a number, with all that a frame can have."""
    return _frame


@pytest.fixture
def detector(rgb_manifest: Manifest, two_trees: dict[str, Any]) -> TreeDetector:
    return TreeDetector(FakeSession.with_trees(rgb_manifest, **two_trees))


@pytest.fixture
def serving(detector: TreeDetector) -> Iterator[Callable[..., Running]]:
    """A function that starts a service, as a context; what is left is closed."""

    pytest.importorskip("zmq")

    @contextmanager
    def start(address: str = "tcp://127.0.0.1:0", silent_s: float = 5.0) -> Iterator[Running]:
        with Service(address, silent_s=silent_s) as service:
            pipeline = LivePipeline(
                service.open_source, detector, reopen_s=0.02, on_unused=service.unused
            )
            service.status_of = lambda: pipeline.status
            results: list[Any] = []

            def follow() -> None:
                for result in pipeline:
                    results.append(result)
                    service.write(result)

            thread = threading.Thread(target=follow)
            thread.start()
            try:
                yield Running(service, pipeline, results)
            finally:
                pipeline.stop()
                thread.join()

    with ExitStack() as stack:
        yield lambda *args, **options: stack.enter_context(start(*args, **options))


@pytest.fixture
def running(serving: Callable[..., Running]) -> Running:
    return serving()


@pytest.fixture
def client(running: Running) -> Iterator[Client]:
    with Client(running.service.address, timeout_s=20.0) as one:
        yield one


@pytest.fixture
def dealer(running: Running) -> Iterator[Any]:
    """A socket of a program that sends what it wants."""
    zmq = pytest.importorskip("zmq")
    context = zmq.Context()
    with context.socket(zmq.DEALER) as socket:
        socket.setsockopt(zmq.LINGER, 0)
        socket.setsockopt(zmq.RCVTIMEO, 20_000)
        socket.connect(running.service.address)
        yield socket
    context.term()
