"""The service: takes frames of other programs, and sends them and those that watch the results."""

from __future__ import annotations

import itertools
import json
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import msgspec

from basetree.errors import InputError
from basetree.program.python import installed_version
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.results.json_records import live_record
from edgetree.serve.faults import Faults
from edgetree.serve.handed import HandedFrame, inline_pixels
from edgetree.serve.messages import (
    AskMessage,
    ByeMessage,
    ErrorAnswer,
    FrameMessage,
    Message,
    ResultAnswer,
    StatusAnswer,
    UnusedAnswer,
    id_in,
    read_message,
)
from edgetree.serve.router import Letter, Router, Sender
from edgetree.serve.shared_memory import OpenMemories, remove_left_behind
from edgetree.serve.source import HandedFrames
from edgetree.sources.pushed import Handover
from edgetree.sources.source import SourceLost

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.live.status import LiveStatus

_NEWER: Final = "a newer frame had arrived"
_GONE: Final = "the program that handed frames over has gone"
_ENDS: Final = "the service ends"
_OTHER_SOURCE: Final = (
    "the service measures another source: expected `edgetree live clients`, or messages that watch"
)
_MOST_WATCHERS: Final = 1024
_AT_ONCE: Final = 64  # messages that are read before answers are sent
_ASK_AGAIN_S: Final = 0.5
_TURN_S: Final = 0.2


@dataclass(frozen=True)
class _Asked:
    """A frame that waits for its answer: who handed it over, and the id that it has there."""

    sender: Sender
    id: int


class Service:
    """Listens for programs on this machine.

    One program at a time hands frames over, any number watch the results. The results may be of
    another source too. Nothing that a program does, or does not do, makes the service wait.

    As a context manager, it listens during the block.

    Args:
        address: Such as tcp://127.0.0.1:8430, where port 0 is any free one, or ipc:///run/FILE.
        takes_frames: Whether programs may hand frames over; if not, they watch alone.
        silent_s: After this time without a frame another program may hand frames over, and the
            source is lost.

    Attributes:
        address: Where it listens.
        status_of: Returns the state of the pipeline; None until there is one.

    Raises:
        InputError: The address cannot be used.
        Unavailable: It is taken.
        MissingPackage: ZeroMQ is not installed.
    """

    def __init__(self, address: str, *, takes_frames: bool = True, silent_s: float = 5.0) -> None:
        self._faults = Faults()
        self._router = Router(address, self._faults)
        self.address = self._router.address
        self.status_of: Callable[[], LiveStatus] | None = None
        self._takes_frames, self._silent_s = takes_frames, silent_s
        self._answers: queue.SimpleQueue[tuple[Sender | None, bytes]] = queue.SimpleQueue()
        self._asked: dict[int, _Asked] = {}
        self._watchers: set[Sender] = set()
        self._memories = OpenMemories()
        self._numbers = itertools.count()
        self._hander: Sender | None = None
        self._heard_s = self._asked_hander_s = 0.0
        self._frames = self._handover()
        self._is_opened = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="edgetree-serve", daemon=True)

    def start(self) -> None:
        """Start to listen."""
        remove_left_behind()
        self._thread.start()

    def close(self) -> None:
        """Send the last answers, disconnect all programs and stop listening."""
        for number in list(self._asked):
            self._left_out(number, _ENDS)
        self._closing.set()
        self._frames.end()
        self._router.wake()
        if self._thread.is_alive():
            self._thread.join()
        self._memories.close()
        self._router.close()

    def __enter__(self) -> Service:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open_source(self, rig: Rig | None = None) -> HandedFrames:
        """The frames that programs hand over, as a source.

        Args:
            rig: Its camera takes the place of the frames' own; it corrects the depth.

        Raises:
            SourceLost: No program hands frames over any more.
        """
        if self._is_opened and self._hander is None:
            raise SourceLost("no program hands frames over")
        self._is_opened = True
        return HandedFrames(self._frames, rig or Rig(), self._refused)

    def write(self, result: LiveResult) -> None:
        """Answer a frame with its result, and send it to those that watch."""
        record = live_record(result)
        asked = (
            self._asked.pop(result.frame.number, None) if result.frame.number is not None else None
        )
        if asked is not None:
            self._send(asked.sender, _result(asked.id, record))
        if self._watchers:
            self._send(None, _result(None, record))

    def unused(self, frame: Frame, reason: str) -> None:
        """Answer a frame that has no result."""
        if frame.number is not None:
            self._left_out(frame.number, reason)

    def _left_out(self, number: int, reason: str) -> None:
        if (asked := self._asked.pop(number, None)) is not None:
            self._send(asked.sender, _text(UnusedAnswer(asked.id, reason)))

    def _refused(self, number: int, error: str) -> None:
        """Answer a frame of which a value cannot be used."""
        if (asked := self._asked.pop(number, None)) is not None:
            self._send(asked.sender, _text(ErrorAnswer(asked.id, error)))
            self._faults.note("frame that cannot be used", error)

    def _send(self, sender: Sender | None, text: bytes) -> None:
        """Have an answer sent, to all that watch if there is no sender. For any thread."""
        self._answers.put((sender, text))
        self._router.wake()

    def _handover(self) -> Handover[HandedFrame]:
        return Handover(
            newest_only=True, on_replaced=lambda frame: self._left_out(frame.number, _NEWER)
        )

    def _run(self) -> None:
        """The thread that listens and sends."""
        try:
            while not self._closing.is_set():
                self._router.wait(_TURN_S)
                self._take_letters()
                self._notice_silence()
            self._send_answers()
        except BaseException as error:
            self._frames.end(error)  # which the pipeline raises
            raise

    def _take_letters(self) -> None:
        """Send the answers that are there, and take some messages."""
        self._send_answers()
        for _ in range(_AT_ONCE):
            if (letter := self._router.receive()) is None:
                return
            self._take(letter)
        self._router.wake()

    def _send_answers(self) -> None:
        while True:
            try:
                sender, text = self._answers.get_nowait()
            except queue.Empty:
                return
            if sender is not None:
                self._sent(sender, text)
                continue
            for watcher in list(self._watchers):
                self._sent(watcher, text)

    def _sent(self, sender: Sender, text: bytes) -> None:
        state = self._router.send(sender, text)
        if sender == self._hander:
            self._heard_s = time.monotonic()
        if state == "unread":
            self._faults.note(
                "answer that was not sent",
                "a program does not read its answers: expected it to receive as it sends",
            )
        elif state == "gone":
            self._watchers.discard(sender)
            if sender == self._hander:
                self._release(_GONE)

    def _notice_silence(self) -> None:
        is_silent = time.monotonic() - self._heard_s > self._silent_s
        if self._hander is not None and is_silent and not self._asked:
            self._release(f"no program has handed a frame over for {self._silent_s:g} s")

    def _release(self, why: str) -> None:
        """Let another program hand frames over; the source is lost until it does."""
        self._hander = None
        self._memories.close()
        before, self._frames = self._frames, self._handover()
        before.end(SourceLost(why))
        for number in list(self._asked):  # nobody may come to take the frame that waits
            self._left_out(number, why)

    def _take(self, letter: Letter) -> None:
        """Do what a message asks for."""
        try:
            message = read_message(letter.parts[0])
        except InputError as error:
            id_ = id_in(letter.parts[0])
            self._refuse(letter.sender, id_, "message that cannot be read", str(error))
            return
        if isinstance(message, FrameMessage):
            self._take_frame(letter, message)
        else:
            self._take_word(letter.sender, message)

    def _take_word(self, sender: Sender, message: Message) -> None:
        """Do what a message without pixels asks for."""
        if isinstance(message, AskMessage):
            self._sent(sender, _text(self._status()))
        elif isinstance(message, ByeMessage):
            self._watchers.discard(sender)
            if sender == self._hander:
                self._release("the program that handed frames over has ended")
        elif sender in self._watchers or len(self._watchers) < _MOST_WATCHERS:
            self._watchers.add(sender)
        else:
            error = f"{_MOST_WATCHERS} programs watch: expected no more"
            self._refuse(sender, None, "program too many", error)

    def _is_taken(self, sender: Sender) -> bool:
        """Whether another program hands frames over; one that has died is found out by a status."""
        if self._hander is None or self._hander == sender:
            return False
        now_s = time.monotonic()
        if now_s - self._asked_hander_s > _ASK_AGAIN_S:
            self._asked_hander_s = now_s
            if self._router.send(self._hander, _text(self._status())) == "gone":
                self._release(_GONE)
        return self._hander is not None

    def _take_frame(self, letter: Letter, message: FrameMessage) -> None:
        sender, refuse = letter.sender, partial(self._refuse, letter.sender, message.id)
        if not self._takes_frames:
            refuse("frame that nobody asked for", _OTHER_SOURCE)
            return
        if self._is_taken(sender):
            refuse(
                "program too many",
                "another program hands frames over: expected one at a time; its place is free"
                f" {self._silent_s:g} s after its last frame",
            )
            return
        try:
            colour, depth = inline_pixels(message, letter.parts[1:])
            if message.colour is not None and message.colour.memory is not None:
                colour = self._memories.read(message.colour)
            if message.depth is not None and message.depth.memory is not None:
                depth = self._memories.read(message.depth)
        except InputError as error:
            refuse("frame that cannot be used", str(error))
            return
        self._hander, self._heard_s = sender, time.monotonic()
        number = next(self._numbers)
        self._asked[number] = _Asked(sender, message.id)
        if not self._frames.put(HandedFrame(number, message, colour, depth)):
            self._left_out(number, _ENDS)

    def _refuse(self, sender: Sender, id_: int | None, kind: str, error: str) -> None:
        self._faults.note(kind, error)
        self._sent(sender, _text(ErrorAnswer(id_, error)))

    def _status(self) -> StatusAnswer:
        status = None if self.status_of is None else self.status_of()
        return StatusAnswer(
            version=installed_version("edgetree") or "",
            state="starting" if status is None else status.state,
            results=0 if status is None else status.results,
            silent_s=0.0 if status is None else round(status.silent_s, 3),
            line="starting" if status is None else status.line(),
            faults=dict(self._faults.counts),
        )


def _result(id_: int | None, record: dict[str, Any]) -> bytes:
    tag = ResultAnswer.__struct_config__.tag
    answer = {"schema": tag, "id": id_, "result": record}
    return json.dumps(answer, allow_nan=False, separators=(",", ":")).encode()


def _text(answer: UnusedAnswer | ErrorAnswer | StatusAnswer) -> bytes:
    return msgspec.json.encode(answer)
