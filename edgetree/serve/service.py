"""The service: takes frames of other programs, and sends them and those that watch the results."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Final

from basetree.errors import InputError
from edgetree.frames.frame import Frame
from edgetree.frames.rig import Rig
from edgetree.results.json_records import live_record
from edgetree.serve.answers import answer_text, result_text, status_answer
from edgetree.serve.faults import Faults
from edgetree.serve.messages import (
    AskMessage,
    ByeMessage,
    ErrorAnswer,
    FrameMessage,
    Message,
    UnusedAnswer,
    id_in,
    read_message,
)
from edgetree.serve.place import Asked, HandingPlace
from edgetree.serve.router import Letter, Router, Sender
from edgetree.serve.shared_memory import remove_left_behind
from edgetree.serve.source import HandedFrames
from edgetree.sources.source import SourceLost

if TYPE_CHECKING:
    from edgetree.live.results import LiveResult
    from edgetree.live.status import LiveStatus

_GONE: Final = "the program that handed frames over has gone"
_OTHER_SOURCE: Final = (
    "the service measures another source: expected `edgetree live clients`, or messages that watch"
)
_MOST_WATCHERS: Final = 1024
_AT_ONCE: Final = 64  # messages that are read before answers are sent
_ASK_AGAIN_S: Final = 0.5
_TURN_S: Final = 0.2


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
        self._watchers: set[Sender] = set()
        self._place = HandingPlace(self._tell_unused)
        self._asked_holder_s = 0.0
        self._is_opened = False
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="edgetree-serve", daemon=True)

    def start(self) -> None:
        """Start to listen."""
        remove_left_behind()
        self._thread.start()

    def close(self) -> None:
        """Send the last answers, disconnect all programs and stop listening."""
        self._place.end()
        self._closing.set()
        self._router.wake()
        if self._thread.is_alive():
            self._thread.join()
        self._place.close()
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
        if self._is_opened and self._place.holder is None:
            raise SourceLost("no program hands frames over")
        self._is_opened = True
        return HandedFrames(self._place.frames, rig or Rig(), self._refused)

    def write(self, result: LiveResult) -> None:
        """Answer a frame with its result, and send it to those that watch."""
        record = live_record(result)
        if (asked := self._place.pop(result.frame.number)) is not None:
            self._send(asked.sender, result_text(asked.id, record))
        if self._watchers:
            self._send(None, result_text(None, record))

    def unused(self, frame: Frame, reason: str) -> None:
        """Answer a frame that has no result."""
        self._place.leave_out(frame.number, reason)

    def _tell_unused(self, asked: Asked, reason: str) -> None:
        self._send(asked.sender, answer_text(UnusedAnswer(asked.id, reason)))

    def _refused(self, number: int, error: str) -> None:
        """Answer a frame of which a value cannot be used."""
        if (asked := self._place.pop(number)) is not None:
            self._send(asked.sender, answer_text(ErrorAnswer(asked.id, error)))
            self._faults.note("frame that cannot be used", error)

    def _send(self, sender: Sender | None, text: bytes) -> None:
        """Have an answer sent, to all that watch if there is no sender. For any thread."""
        self._answers.put((sender, text))
        self._router.wake()

    def _run(self) -> None:
        """The thread that listens and sends."""
        try:
            while not self._closing.is_set():
                self._router.wait(_TURN_S)
                self._take_letters()
                self._notice_silence()
            self._send_answers()
        except BaseException as error:
            self._place.frames.end(error)  # which the pipeline raises
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
        if sender == self._place.holder:
            self._place.heard_s = time.monotonic()
        if state == "unread":
            self._faults.note(
                "answer that was not sent",
                "a program does not read its answers: expected it to receive as it sends",
            )
        elif state == "gone":
            self._watchers.discard(sender)
            if sender == self._place.holder:
                self._release(_GONE)

    def _notice_silence(self) -> None:
        if self._place.is_silent(self._silent_s):
            self._release(f"no program has handed a frame over for {self._silent_s:g} s")

    def _release(self, why: str) -> None:
        """Let another program hand frames over; the source is lost until it does."""
        self._place.release(SourceLost(why))

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
            self._sent(sender, self._status())
        elif isinstance(message, ByeMessage):
            self._watchers.discard(sender)
            if sender == self._place.holder:
                self._release("the program that handed frames over has ended")
        elif sender in self._watchers or len(self._watchers) < _MOST_WATCHERS:
            self._watchers.add(sender)
        else:
            error = f"{_MOST_WATCHERS} programs watch: expected no more"
            self._refuse(sender, None, "program too many", error)

    def _is_taken(self, sender: Sender) -> bool:
        """Whether another program hands frames over; one that has died is found out by a status."""
        if self._place.holder is None or self._place.holder == sender:
            return False
        now_s = time.monotonic()
        if now_s - self._asked_holder_s > _ASK_AGAIN_S:
            self._asked_holder_s = now_s
            if self._router.send(self._place.holder, self._status()) == "gone":
                self._release(_GONE)
        return self._place.holder is not None

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
            self._place.take(sender, message, letter.parts[1:])
        except InputError as error:
            refuse("frame that cannot be used", str(error))

    def _refuse(self, sender: Sender, id_: int | None, kind: str, error: str) -> None:
        self._faults.note(kind, error)
        self._sent(sender, answer_text(ErrorAnswer(id_, error)))

    def _status(self) -> bytes:
        status = None if self.status_of is None else self.status_of()
        return answer_text(status_answer(status, self._faults))
