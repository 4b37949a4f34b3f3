"""The client in Python: hand frames over, get results back, or watch those of others."""

from __future__ import annotations

import itertools
import time
from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, Final, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from calib import PinholeCamera, RigidTransform
from edgetree.errors import ServiceError
from edgetree.frames.frame import Frame
from edgetree.serve.messages import (
    Answer,
    AskMessage,
    ByeMessage,
    Camera,
    Colour,
    Depth,
    ErrorAnswer,
    FrameMessage,
    Memory,
    Pose,
    ResultAnswer,
    StatusAnswer,
    UnusedAnswer,
    WatchMessage,
)
from edgetree.serve.router import zeromq
from edgetree.serve.shared_memory import IS_THERE, UNREADABLE, Slot

_SLOTS: Final = 4
_GOODBYE_MS: Final = 500
_MOST_MESSAGES: Final = 64


class Client:
    """A connection to the service of `edgetree live --serve`. For one thread.

    It connects by itself, and again when the service was gone.

    Args:
        address: Where the service listens.
        timeout_s: Longest time to wait for an answer, s.
        shared_memory: Whether pixels go through shared memory; by default where there is some. They
            go with the messages if the service cannot read it, as that of another user.

    Examples:
        >>> from edgetree.serve import Client
        >>> with Client("tcp://127.0.0.1:8430") as client:  # doctest: +SKIP
        ...     record = client.measure(frame)

    Raises:
        MissingPackage: ZeroMQ is not installed.
    """

    def __init__(
        self,
        address: str = "tcp://127.0.0.1:8430",
        *,
        timeout_s: float = 10.0,
        shared_memory: bool | None = None,
    ) -> None:
        self._zmq = zmq = zeromq()
        self._address, self._timeout_s = address, timeout_s
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.DEALER)
        self._socket.setsockopt(zmq.LINGER, _GOODBYE_MS)
        self._socket.setsockopt(zmq.SNDHWM, _MOST_MESSAGES)
        self._socket.connect(address)
        self._uses_memory = IS_THERE if shared_memory is None else shared_memory
        self._free = [Slot() for _ in range(_SLOTS)]
        self._used: dict[int, Slot] = {}
        self._ids = itertools.count()
        self._early: deque[Answer] = deque()  # to frames of `send`, while another was waited for
        self._given_up: set[int] = set()  # frames of `measure` without an answer in time

    def measure(self, frame: Frame) -> dict[str, Any]:
        """Hand a frame over and wait for its result.

        Args:
            frame: The frame, as `edgetree.sources.frame_from_arrays` makes it; it needs a time.

        Returns:
            A record of the schema edgetree.live/1.

        Raises:
            ServiceError: The frame was left out, cannot be used, or there is no answer in time.
        """
        answer = self._answer_to(self.send(frame))
        if isinstance(answer, ErrorAnswer) and answer.error.startswith(UNREADABLE):
            # The service has begun anew and does not know the memory, which is new now.
            answer = self._answer_to(self.send(frame))
        if isinstance(answer, ResultAnswer):
            return answer.result
        if isinstance(answer, UnusedAnswer):
            raise ServiceError(f"the frame was left out: {answer.reason}")
        raise ServiceError(answer.error)

    def send(self, frame: Frame) -> int:
        """Hand a frame over without waiting; returns the id that its answer will have.

        Raises:
            InputError: The frame has no time stamp.
            ServiceError: The service does not take messages.
        """
        about = FrameMessage(
            0,
            frame.stamp_s,
            camera=None if frame.camera is None else _camera(frame.camera),
            up_camera=None if frame.up_camera is None else _triple(frame.up_camera),
            pose=None if frame.pose is None else _pose(frame.pose),
        )
        return self.send_arrays(about, frame.image, frame.depth_m)

    def send_arrays(
        self, about: FrameMessage, colour: NDArray[np.uint8] | None, depth: NDArray[Any] | None
    ) -> int:
        """Hand arrays of a driver over without waiting.

        Args:
            about: What is known of the frame; its id and images are filled in, but for the scale
                and the kind of the depth.
            colour: (H, W, 3) uint8 BGR; None if there is only depth.
            depth: (H, W) uint16 or float32; None if there is only colour.

        Returns:
            The id that the answer will have.

        Raises:
            ServiceError: The service does not take messages.
        """
        id_ = next(self._ids)
        arrays = [np.ascontiguousarray(array) for array in (colour, depth) if array is not None]
        memories, parts = self._placed(id_, arrays)
        places = iter(memories)
        message = msgspec.structs.replace(
            about,
            id=id_,
            colour=None
            if colour is None
            else Colour(colour.shape[1], colour.shape[0], memory=next(places)),
            depth=None if depth is None else _depth(depth, about.depth, next(places)),
        )
        self._send(msgspec.json.encode(message), *parts)
        return id_

    def receive(self, timeout_s: float | None = None) -> Answer:
        """Wait for the next answer, of whatever frame.

        Args:
            timeout_s: Longest time to wait, s; that of the client if None.

        Raises:
            ServiceError: There is none in time.
        """
        if self._early:
            return self._early.popleft()
        timeout_s = self._timeout_s if timeout_s is None else timeout_s
        return self._received(timeout_s, timeout_s)

    def _received(self, wait_s: float, timeout_s: float) -> Answer:
        """The next answer within `wait_s`; an error names `timeout_s`, the whole time waited."""
        end_s = time.monotonic() + wait_s
        while True:
            if not self._socket.poll(max(0.0, end_s - time.monotonic()) * 1000):
                raise ServiceError(
                    f"the service at {self._address} does not answer within {timeout_s:.2g} s:"
                    " expected edgetree live --serve there"
                )
            answer: Answer = msgspec.json.decode(self._socket.recv_multipart()[-1], type=Answer)
            id_ = None if isinstance(answer, StatusAnswer) else answer.id
            if id_ is not None and (slot := self._used.pop(id_, None)) is not None:
                self._give_back(slot, answer)
            if id_ not in self._given_up:
                return answer
            self._given_up.discard(id_)

    def watch(self) -> Iterator[dict[str, Any]]:
        """Yield each result of the service from now on, of whatever source, without end.

        Raises:
            ServiceError: No result comes in time, or too many programs watch.
        """
        self._send(msgspec.json.encode(WatchMessage()))
        while True:
            answer = self.receive()
            if isinstance(answer, ResultAnswer) and answer.id is None:
                yield answer.result
            elif isinstance(answer, ErrorAnswer) and answer.id is None:
                raise ServiceError(answer.error)

    def status(self) -> StatusAnswer:
        """How the service is.

        Raises:
            ServiceError: It does not answer.
        """
        self._send(msgspec.json.encode(AskMessage()))
        end_s = time.monotonic() + self._timeout_s
        while True:
            answer = self._received(end_s - time.monotonic(), self._timeout_s)
            if isinstance(answer, StatusAnswer):
                return answer
            self._keep(answer)

    def close(self) -> None:
        """Say goodbye and disconnect."""
        with suppress(ServiceError):
            self._send(msgspec.json.encode(ByeMessage()))
        self._socket.close()
        self._context.term()
        for slot in (*self._free, *self._used.values()):
            slot.close()

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _give_back(self, slot: Slot, answer: Answer) -> None:
        """Let the memory of a frame that has its answer be used again."""
        if not isinstance(answer, ErrorAnswer):
            slot.was_read = True
        elif answer.error.startswith(UNREADABLE) and not slot.was_read:
            # New memory is unreadable for a service of another user: pixels go with the messages.
            self._uses_memory = False
        if isinstance(answer, ErrorAnswer):
            slot.close()
        self._free.append(slot)

    def _answer_to(self, id_: int) -> ResultAnswer | UnusedAnswer | ErrorAnswer:
        end_s = time.monotonic() + self._timeout_s
        while True:
            try:
                answer = self._received(end_s - time.monotonic(), self._timeout_s)
            except ServiceError:
                self._given_up.add(id_)
                raise
            if not isinstance(answer, StatusAnswer) and answer.id == id_:
                return answer
            self._keep(answer)

    def _keep(self, answer: Answer) -> None:
        """Keep the answer to a frame that `send` handed over, for `receive`."""
        if not isinstance(answer, StatusAnswer) and answer.id is not None:
            self._early.append(answer)

    def _placed(
        self, id_: int, arrays: list[NDArray[Any]]
    ) -> tuple[list[Memory | None], list[NDArray[Any]]]:
        """Where each array is in shared memory; or None, and the arrays as parts of the message."""
        if not (self._uses_memory and self._free):
            return [None] * len(arrays), arrays
        slot = self._used[id_] = self._free.pop()
        try:
            return [Memory(slot.name, offset) for offset in slot.write(arrays)], []
        except OSError:  # no shared memory left
            self._free.append(self._used.pop(id_))
            return [None] * len(arrays), arrays

    def _send(self, *parts: bytes | NDArray[Any]) -> None:
        try:
            self._socket.send_multipart(list(parts), self._zmq.NOBLOCK)
        except self._zmq.Again as error:
            raise ServiceError(
                f"{_MOST_MESSAGES} messages wait for the service at {self._address}: expected"
                " edgetree live --serve there"
            ) from error


def _camera(camera: PinholeCamera) -> Camera:
    return Camera(**{**camera.to_dict(), "distortion": camera.distortion})


def _triple(values: NDArray[Any]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _pose(pose: RigidTransform) -> Pose:
    first, second, third = (_triple(row) for row in pose.rotation)
    return Pose((first, second, third), _triple(pose.translation_m))


def _depth(depth: NDArray[Any], about: Depth | None, memory: Memory | None) -> Depth:
    """What the service has to know of a depth array."""
    height, width = depth.shape
    kind: Literal["uint16", "float32"] = "uint16" if depth.dtype == np.uint16 else "float32"
    if about is None:
        return Depth(width, height, kind, memory=memory)
    return Depth(width, height, kind, about.scale_m, about.kind, memory)
